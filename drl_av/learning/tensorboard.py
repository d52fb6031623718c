"""TensorBoard events of a training, where they are asked for."""

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from drl_av.errors import DrlAvError
from drl_av.learning.run import Progress


def require_tensorboard() -> None:
    """Raise DrlAvError where the package is not installed, before any training."""
    if importlib.util.find_spec("tensorboard") is None:
        raise DrlAvError(
            "--tensorboard needs the package tensorboard: pip install 'drl-av[tensorboard]'."
        )


@contextmanager
def tensorboard_writer(
    folder: Path | None, episodes_done: int
) -> Iterator[Callable[[Progress], None]]:
    """A function that writes an episode's numbers as scalars; without a folder it writes nothing.

    The scalars are ``episode/COLUMN`` and ``evaluation/COLUMN``. Those of later episodes than
    ``episodes_done``, which a stopped training wrote, are taken back.
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
