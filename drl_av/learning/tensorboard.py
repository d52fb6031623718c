"""Writes TensorBoard events of a training."""

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from drl_av.errors import DrlAvError
from drl_av.learning.run import Progress


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
    """A function that writes the numbers of an episode as scalars; does nothing without a folder.

    The scalars are ``episode/COLUMN`` and ``evaluation/COLUMN``. Scalars of episodes after
    ``episodes_done``, which a stopped training wrote, are purged.
    """
    if folder is None:
        yield lambda progress: None
        return
    from torch.utils.tensorboard import SummaryWriter

    writer = SummaryWriter(str(folder), purge_step=episodes_done + 1)

    def write(progress: Progress) -> None:
        for group, row in (("episode", progress.episode), ("evaluation", progress.evaluation)):
            for name, value in asdict(row).items() if row else ():
                writer.add_scalar(f"{group}/{name}", value, progress.episode.episode)

    try:
        yield write
    finally:
        writer.close()
