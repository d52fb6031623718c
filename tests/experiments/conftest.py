"""An engine that works in this process, so that tests can look into the work."""

from collections.abc import Callable, Iterator

import pytest

from drl_av.experiments import engines
from drl_av.experiments.training_jobs import TrainingJob


def here(
    work: Callable[[TrainingJob], None], jobs: list[TrainingJob], processes: int
) -> Iterator[list[TrainingJob]]:
    for job in jobs:
        work(job)
        yield [job]


@pytest.fixture(autouse=True)
def _engine_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(engines.ENGINES, "here", here)
