"""The store of results: what it writes beside a table it reads again."""

from pathlib import Path

import pytest

from drl_av.config import Config
from drl_av.evaluation.provenance import read_sidecar
from studies.options import ReproduceOptions
from studies.store import MadeWith, ResultStore


def opened(folder: Path) -> ResultStore:
    made_with = MadeWith({"": Config()}, {"": None})
    return ResultStore(folder / "t.csv", made_with, lambda row: int(row["seed"]))


@pytest.mark.parametrize(
    ("seconds", "written"),
    [
        ({"": 12.0}, 12.0),
        ({"paper-0": 72.5, "paper-1": 80.0}, {"paper-0": 72.5, "paper-1": 80.0}),
        ({"": 12.0, "paper-0": 72.5}, {"": 12.0, "paper-0": 72.5}),
    ],
    ids=["evaluations", "trainings", "both"],
)
def test_the_wall_times_of_evaluations_and_of_trainings_are_both_kept(
    tmp_path: Path, seconds: dict[str, float], written: object
) -> None:
    store = opened(tmp_path)
    store.put({"seed": "0"}, [{"seed": "0", "reward": "-0.5"}])
    store.seconds |= seconds
    store.save(ReproduceOptions())
    assert read_sidecar(tmp_path / "t.csv")["wall_time_s"] == written
    again = opened(tmp_path)
    assert (again.seconds, again.rows) == (seconds, [{"seed": "0", "reward": "-0.5"}])
