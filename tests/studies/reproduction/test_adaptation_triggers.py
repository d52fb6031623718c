"""Adaptation made anew: the shipped driver on the same traffic, with learning and without."""

from pathlib import Path
from typing import Any

import pytest

from drl_av.learning.checkpoint import load_policy
from drl_av.studies.drivers import PRETRAINED
from drl_av.studies.reproduction import adaptation as module
from drl_av.studies.reproduction import trainings
from drl_av.studies.reproduction.adaptation import adaptation
from drl_av.studies.reproduction.legs import Leg
from drl_av.studies.reproduction.scale import Scale
from drl_av.studies.reproduction.tables import read_rows

SETTINGS = """
[simulation]
decisions_per_episode = 15
[learning]
episodes = 5
evaluate_every = 5
evaluation_episodes = 1
collisions_to_start = 0
"""


def here(work: Any, jobs: list[Leg], processes: int) -> Any:
    for job in jobs:
        work(job)
        yield [job]


def test_both_begin_as_the_shipped_driver_and_only_one_of_them_learns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "settings.toml").write_text(SETTINGS)
    monkeypatch.setitem(trainings.ENGINES, "here", here)
    monkeypatch.setattr(module, "BLOCK", 2)
    runs = tmp_path / "runs"
    config = str(tmp_path / "settings.toml")
    list(adaptation(Scale(engine="here", runs=runs, out=tmp_path, config=config)))
    rows = read_rows(tmp_path / "adaptation.csv")
    assert [(row["variant"], row["seed"], row["episode"]) for row in rows] == [
        (variant, "0", episode)
        for variant in ("adaptation", "no_adaptation")
        for episode in ("2", "4", "5")
    ]
    shipped, _ = load_policy(PRETRAINED / "policy.safetensors")
    changed = {}
    for variant in ("adaptation", "no_adaptation"):
        network, _ = load_policy(runs / f"{variant}-0" / "policy.safetensors")
        changed[variant] = bool((network.flat != shipped.flat).any())
    assert changed == {"adaptation": True, "no_adaptation": False}
    seeds = [
        [row["seed"] for row in read_rows(runs / f"{variant}-0" / "episodes.csv")]
        for variant in changed
    ]
    assert seeds[0] == seeds[1]
