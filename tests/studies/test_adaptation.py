"""Continual adaptation: the shipped driver on the same traffic, with learning and without."""

import json
from pathlib import Path

import numpy as np
import pytest

from drl_av.drivers.policy_file import load, load_policy
from drl_av.errors import DrlAvError
from drl_av.evaluation.provenance import checksum
from studies import adaptation as module
from studies.adaptation import ADAPTATION
from studies.experiment import reproduce
from studies.options import ReproduceOptions
from studies.store import read_rows

SETTINGS = """
[simulation]
decisions_per_episode = 15
[learning]
episodes = 5
evaluate_every = 5
evaluation_episodes = 1
collisions_to_start = 0
"""


@pytest.fixture
def options(tmp_path: Path) -> ReproduceOptions:
    """Five short episodes, in this process."""
    (tmp_path / "settings.toml").write_text(SETTINGS)
    config = str(tmp_path / "settings.toml")
    return ReproduceOptions(engine="here", runs=tmp_path / "runs", out=tmp_path, config=(config,))


def test_both_begin_as_the_shipped_driver_trained_again_and_only_one_of_them_learns(
    options: ReproduceOptions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "BLOCK", 2)
    runs = options.runs
    list(reproduce(ADAPTATION, options))
    rows = read_rows(tmp_path / "adaptation.csv")
    assert [(row["variant"], row["seed"], row["episode"]) for row in rows] == [
        (variant, "0", episode)
        for variant in ("adaptation", "no_adaptation")
        for episode in ("2", "4", "5")
    ]
    names = ("pretrained-1", "pretrained-1/adaptation-0", "pretrained-1/no_adaptation-0")
    weights, remembered = {}, {}
    for name in names:
        networks, _ = load_policy(runs / name / "policy.safetensors")
        tensors, _ = load(runs / name / "checkpoint.safetensors")
        weights[name] = np.concatenate([network.flat for network in networks])
        remembered[name] = sum(
            len(tensors[f"buffer.{kind}.rows"]) for kind in ("safe", "collision")
        )
    changed = {name: bool((weights[name] != weights[names[0]]).any()) for name in names}
    assert list(changed.values()) == [False, True, False]
    # what is driven since comes on top of the training's own experience
    assert all(remembered[name] > remembered[names[0]] > 15 for name in names[1:])
    seeds = [[row["seed"] for row in read_rows(runs / name / "episodes.csv")] for name in names[1:]]
    assert seeds[0] == seeds[1]


def test_a_complete_table_asks_for_no_training(options: ReproduceOptions, tmp_path: Path) -> None:
    list(reproduce(ADAPTATION, options))
    list(reproduce(ADAPTATION, options._replace(runs=tmp_path / "elsewhere")))
    assert not (tmp_path / "elsewhere").exists()


def test_rows_of_another_driver_never_come_into_a_table(
    options: ReproduceOptions, tmp_path: Path
) -> None:
    list(reproduce(ADAPTATION, options))
    table = tmp_path / "adaptation.csv"
    policy = checksum(tmp_path / "runs" / "pretrained-1" / "policy.safetensors")
    facts = json.loads((tmp_path / "adaptation.json").read_text())
    assert facts["policies_sha256"] == {"pretrained-1": policy}
    facts["policies_sha256"] = {"pretrained-1": "that of another"}
    (tmp_path / "adaptation.json").write_text(json.dumps(facts))
    before = table.read_bytes()
    with pytest.raises(DrlAvError, match=r"adaptation\.csv was made with .* another driver"):
        list(reproduce(ADAPTATION, options._replace(full_seeds=2)))
    assert table.read_bytes() == before
    assert not (tmp_path / "runs" / "pretrained-1" / "adaptation-1").exists()
