"""The preset ``fast`` beside the whole schedule, as an experiment of ``drl-av reproduce``."""

import json
import shutil
from pathlib import Path

import pytest

from drl_av.errors import DrlAvError
from drl_av.experiments import fast as module
from drl_av.experiments import trained_drivers
from drl_av.experiments.legs import wall_time_s
from drl_av.experiments.options import Progress, Scale
from drl_av.experiments.tables import read_rows

SHORT = """
[simulation]
decisions_per_episode = 4
[learning]
episodes = 2
evaluate_every = 1
evaluation_episodes = 1
"""


def told(progress: list[Progress]) -> set[str]:
    return {each.told for each in progress}


def test_every_seed_is_trained_and_driven_through_the_traffic_of_the_long_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trained_drivers, "DENSITIES", (1, 2))
    (tmp_path / "short.toml").write_text(SHORT)
    runs, out, config = tmp_path / "runs", tmp_path / "out", str(tmp_path / "short.toml")
    scale = Scale(seeds=2, drives=2, jobs=1, runs=runs, out=out, config=config)
    first = list(module.fast(scale))
    assert first[-1][:2] == (12, 12)  # three trainings, two densities, two seeds
    rows = read_rows(out / "fast.csv")
    assert [(row["training"], row["vehicles"], row["seed"]) for row in rows] == [
        (training, vehicles, seed)
        for training in ("paper-0", "fast-0", "fast-1")
        for vehicles in ("1", "2")
        for seed in ("0", "1")
    ]
    facts = json.loads((out / "fast.json").read_text())
    trainings = ["paper-0", "fast-0", "fast-1"]
    assert list(facts["policies_sha256"]) == trainings
    assert facts["episodes"] == dict.fromkeys(trainings, 2)
    clocks = {name: wall_time_s(runs / f"{name}.seconds.csv") for name in trainings}
    assert facts["wall_time_s"] == pytest.approx(clocks, abs=0.05)

    # what is there is not made again, wherever the trainings are
    runs.rename(tmp_path / "elsewhere")
    assert list(module.fast(scale)) == []
    # a table that is lost, or lost in part, is driven again and nothing is trained
    shutil.rmtree(runs)
    (tmp_path / "elsewhere").rename(runs)
    whole = (out / "fast.csv").read_text()
    (out / "fast.csv").write_text("".join(whole.splitlines(keepends=True)[:9]))
    assert told(list(module.fast(scale))) == {"training", "fast-1"}
    assert (out / "fast.csv").read_text() == whole
    (out / "fast.csv").unlink()
    assert told(list(module.fast(scale))) == {"training", "paper-0", "fast-0", "fast-1"}
    assert (out / "fast.csv").read_text() == whole
    more = list(module.fast(scale._replace(drives=3)))
    assert more[-1][:2] == (6, 6)  # the third seed of each
    rows = read_rows(out / "fast.csv")
    assert [row["seed"] for row in rows] == ["0", "1", "2"] * 6

    # fewer trainings lose nothing of what is there, and more are trained alone
    assert list(module.fast(scale._replace(drives=3, seeds=1))) == []
    (runs / "paper-0").rename(tmp_path / "paper-0")
    assert told(list(module.fast(scale._replace(drives=3, seeds=3)))) == {"training", "fast-2"}
    assert not (runs / "paper-0").exists()
    assert read_rows(out / "fast.csv")[:18] == rows

    # other settings are told before anything is trained
    (tmp_path / "short.toml").write_text(SHORT.replace("decisions_per_episode = 4", ""))
    before = (out / "fast.csv").read_bytes()
    with pytest.raises(DrlAvError, match=r"fast\.csv was made with other settings"):
        list(module.fast(scale._replace(drives=4)))
    assert (out / "fast.csv").read_bytes() == before
