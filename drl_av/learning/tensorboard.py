"""Writes the rows of a training by Algorithm 1 as TensorBoard scalars."""

import importlib.util
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict
from pathlib import Path

from drl_av.errors import DrlAvError
from drl_av.learning.run_folder import Progress, refusals


def require_tensorboard() -> None:
    """Raise DrlAvError if the package tensorboard is not installed."""
    if importlib.util.find_spec("tensorboard") is None:
        raise DrlAvError(
            "--tensorboard needs the package tensorboard: pip install 'drl-av[tensorboard]'."
        )


@contextmanager
def tensorboard_writer(
    folder: Path | None, episodes_done: int
) -> Iterator[Callable[[Progress], None]]:
    """Yield a function that writes the table rows of an episode as TensorBoard scalars.

    The scalars are ``episode/COLUMN`` and ``evaluation/COLUMN``. If ``folder`` is None, the
    function does nothing. If an interrupted training has already written scalars of episodes after
    ``episodes_done``, TensorBoard discards them. Raises RunError if the folder cannot be written.
    """
    if folder is None:
        yield lambda progress: None
        return
    from torch.utils.tensorboard import SummaryWriter

    hook = threading.excepthook
    _quiet_refusal(hook)
    with _refusals_of(folder):
        writer = SummaryWriter(str(folder), purge_step=episodes_done + 1)

    def write(progress: Progress) -> None:
        for group, row in (("episode", progress.episode), ("evaluation", progress.evaluation)):
            for name, value in asdict(row).items() if row else ():
                with _refusals_of(folder):
                    writer.add_scalar(f"{group}/{name}", value, progress.episode.episode)

    try:
        yield write
    finally:
        with _refusals_of(folder):
            writer.close()
        threading.excepthook = hook


def _quiet_refusal(hook: Callable[[threading.ExceptHookArgs], object]) -> None:
    """Do not print an OSError of TensorBoard's thread, because ``add_scalar`` raises it again."""

    def report(problem: threading.ExceptHookArgs) -> None:
        if not isinstance(problem.exc_value, OSError):
            hook(problem)

    threading.excepthook = report


def _refusals_of(folder: Path) -> AbstractContextManager[None]:
    return refusals(
        f"The TensorBoard events in {folder} cannot be written",
        "free some space, or continue with --resume and without --tensorboard",
    )
