"""What the learning curves' trainings end in, as an experiment of ``drl-av reproduce``."""

import json
from contextlib import closing
from pathlib import Path

import pytest

from drl_av.env import HighwayEnv
from drl_av.episode import drive
from drl_av.errors import DrlAvError
from drl_av.studies.drivers import learned_driver
from drl_av.studies.reproduction import trained_drivers
from drl_av.studies.reproduction.curves import curves
from drl_av.studies.reproduction.ends import ends
from drl_av.studies.reproduction.scale import Scale
from drl_av.studies.reproduction.tables import read_rows

SHORT = """
[simulation]
decisions_per_episode = 4
[traffic]
vehicles_max = 3
[learning]
episodes = 3
evaluate_every = 1
evaluation_episodes = 1
"""


@pytest.fixture
def scale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scale:
    """Two seeds stop after 2 of 3 episodes, and seed 0 goes on."""
    monkeypatch.setattr(trained_drivers, "DENSITIES", (1, 2))
    (tmp_path / "short.toml").write_text(SHORT)
    runs, out, config = tmp_path / "runs", tmp_path / "out", str(tmp_path / "short.toml")
    return Scale(seeds=3, episodes=2, drives=2, jobs=1, runs=runs, out=out, config=config)


def test_those_that_stop_are_driven_each_with_the_check_that_it_learnt_with(scale: Scale) -> None:
    list(ends(scale))
    rows, facts = (
        read_rows(scale.out / "ends.csv"),
        json.loads((scale.out / "ends.json").read_text()),
    )
    trainings = [
        f"{variant}-{seed}" for variant in ("paper", "permit_all", "prioritized") for seed in (1, 2)
    ]
    assert [(row["training"], row["vehicles"], row["seed"]) for row in rows] == [
        (training, vehicles, seed)
        for training in trainings
        for vehicles in ("1", "2")
        for seed in ("0", "1")
    ]
    assert sorted(facts["episodes"].items()) == [(name, 2) for name in trainings]
    checks = {name: facts["settings"][name]["safety"]["check"] for name in trainings}
    assert list(checks.values()) == ["paper", "paper", "permit_all", "permit_all", "paper", "paper"]
    for row in rows:
        driver, config = learned_driver(scale.runs / row["training"])
        with closing(HighwayEnv(config=config)) as env:
            driven = drive(env, driver, "", int(row["seed"]), int(row["vehicles"]))
        assert float(row["mean_reward"]) == driven.mean_reward
        assert row["collided"] == str(driven.collided)

    # they are the trainings of the curves, which find nothing left to do but the third of seed 0
    list(curves(scale._replace(variants=("paper",))))
    assert list(ends(scale)) == []


def test_a_training_that_has_gone_on_is_not_taken_for_one_that_stopped(scale: Scale) -> None:
    list(curves(scale._replace(full_seeds=2)))
    with pytest.raises(DrlAvError, match=r"-1 has gone on to episode 3, and its driver of episode"):
        list(ends(scale))
    assert not (scale.out / "ends.csv").exists()


def test_drivers_of_other_episodes_are_not_mixed(scale: Scale) -> None:
    scale = scale._replace(variants=("paper",))
    list(ends(scale._replace(episodes=1)))
    before = (scale.out / "ends.csv").read_bytes()
    with pytest.raises(DrlAvError, match=r"ends\.csv was made with other settings"):
        list(ends(scale._replace(drives=3)))
    assert (scale.out / "ends.csv").read_bytes() == before


def test_where_all_go_on_to_the_end_there_is_nothing_to_drive(scale: Scale) -> None:
    assert list(ends(scale._replace(full_seeds=3))) == []
    assert not scale.runs.exists() or not list(scale.runs.iterdir())
