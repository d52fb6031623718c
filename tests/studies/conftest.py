"""An engine that works in this process, so that tests see the work, and short settings."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drl_av.evaluation import engines
from studies import ablation
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


class InPlace:
    """A pool of no processes."""

    def __init__(self, jobs: int, initializer: object, initargs: object) -> None:
        pass

    def __enter__(self) -> "InPlace":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    map = staticmethod(map)


@pytest.fixture
def two_episodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A study of trainings drives two episodes among 5 vehicles; its words for one seed, 7."""
    monkeypatch.setattr(ablation, "EPISODES", 2)
    monkeypatch.setattr(ablation, "COUNTS", (5,))
    monkeypatch.setattr(ablation, "drive_rule", lambda runs, kind: None)
    monkeypatch.setattr(np, "load", lambda path: np.full((1, 2), 20.0))
    monkeypatch.setattr(ablation, "ProcessPoolExecutor", InPlace)
    return ["--runs", str(tmp_path / "runs"), "--out", str(tmp_path / "out.csv"), "--seeds", "7"]
