"""TensorBoard events of a training, where they are wanted."""

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Protocol

from drl_av.errors import DrlAvError
from drl_av.learning.run import Progress


class Board(Protocol):
    """Takes what each episode brought."""

    def add(self, progress: Progress) -> None:
        """Show one more episode."""


class NullBoard:
    """Shows nothing."""

    def add(self, progress: Progress) -> None:
        """Let it pass."""


class TensorBoard:
    """Scalars by episode, under ``episode/`` and ``evaluation/``."""

    def __init__(self, folder: Path, episodes_done: int) -> None:
        from torch.utils.tensorboard import SummaryWriter

        self._writer = SummaryWriter(str(folder), purge_step=episodes_done + 1)

    def add(self, progress: Progress) -> None:
        """Write every number of the rows."""
        for group, row in (("episode", progress.episode), ("evaluation", progress.evaluation)):
            for name, value in asdict(row).items() if row else ():
                self._writer.add_scalar(f"{group}/{name}", value, progress.episode.episode)

    def close(self) -> None:
        """Write what is still to be written."""
        self._writer.close()


def require_tensorboard() -> None:
    """Raise DrlAvError where the package is not installed, before any training."""
    if importlib.util.find_spec("tensorboard") is None:
        raise DrlAvError(
            "--tensorboard needs the package tensorboard: pip install 'drl-av[tensorboard]'."
        )


@contextmanager
def board(folder: Path | None, episodes_done: int) -> Iterator[Board]:
    """A board that writes into ``folder``, or none.

    Later episodes that a stopped training wrote there are taken back.
    """
    if folder is None:
        yield NullBoard()
        return
    events = TensorBoard(folder, episodes_done)
    try:
        yield events
    finally:
        events.close()
