"""An engine that works in this process, so that tests see the work, and short settings."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from drl_av.evaluation import engines
from studies.options import Options

SHORT = """
[simulation]
decisions_per_episode = 5
[traffic]
vehicles_max = 3
[learning]
episodes = 2
evaluate_every = 1
evaluation_episodes = 1
collisions_to_start = 0
"""


def here(
    work: Callable[[Any], Any], jobs: Sequence[Any], processes: int
) -> Iterator[list[tuple[int, Any]]]:
    for place, job in enumerate(jobs):
        yield [(place, work(job))]


@pytest.fixture(autouse=True)
def _engine_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(engines.ENGINES, "here", here)


@pytest.fixture
def short(tmp_path: Path) -> Options:
    """Two evaluation episodes of 5 decisions in each cell; a training has two episodes."""
    (tmp_path / "short.toml").write_text(SHORT)
    config, runs, out = (str(tmp_path / "short.toml"),), tmp_path / "runs", tmp_path / "out"
    return Options(1, "here", runs, out, config, most_episodes=2, most_trainings=2)
