"""An engine that works in this process, so that tests see the work, and a short experiment."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drl_av.evaluation import engines
from studies.options import ReproduceOptions
from studies.training_jobs import TrainingJob


def here(
    work: Callable[[TrainingJob], None], jobs: list[TrainingJob], processes: int
) -> Iterator[list[TrainingJob]]:
    for job in jobs:
        work(job)
        yield [job]


@pytest.fixture(autouse=True)
def _engine_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(engines.ENGINES, "here", here)


@pytest.fixture
def short(tmp_path: Path) -> ReproduceOptions:
    """Two evaluation episodes of 5 decisions in each cell; a training has two episodes."""
    config, runs = tmp_path / "short.toml", tmp_path / "runs"
    config.write_text("[simulation]\ndecisions_per_episode = 5\n[learning]\nepisodes = 2\n")
    return ReproduceOptions(drives=2, jobs=1, runs=runs, out=tmp_path, config=(str(config),))
