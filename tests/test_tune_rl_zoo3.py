"""The search for the hyperparameters of ``examples/rl_zoo3.yml``, and what it found."""

import re
import sys
from collections.abc import Mapping
from typing import Any

import pytest
import yaml
from runs import Capsys
from shown import ROOT

from tools import tune_rl_zoo3
from tools.tune_rl_zoo3 import BY_HAND, RANGES, Rating, draw


def test_the_best_trials_are_trained_again_beside_the_values_by_hand_and_the_defaults(
    monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    trials = [BY_HAND | drawn for drawn in draw(3)]
    rewards = [-0.2, -0.4, -0.1]

    def train(settings: Mapping[str, Any], seed: int, decisions: int) -> tuple[int, int]:
        number = trials.index({**settings}) if settings in trials else -1
        return number, seed

    def rate(traffic: int, episodes: int, agent: tuple[int, int] | None = None) -> Rating:
        number, seed = agent or (-1, 0)
        assert traffic == (800_000 if agent and not seed else 801_000)
        return Rating(rewards[number] if number >= 0 else -0.5, 20.0 + seed, seed)

    monkeypatch.setattr(tune_rl_zoo3, "train", train)
    monkeypatch.setattr(tune_rl_zoo3, "rate", rate)
    monkeypatch.setattr(sys, "argv", ["tune_rl_zoo3.py", "--trials", "3", "--best", "2"])
    tune_rl_zoo3.main()
    searched, again = capsys.readouterr().out.split("\n\n")
    assert re.findall(r"^ +(\d)  (\S+)", searched, re.MULTILINE) == [
        ("0", "-0.2000"),
        ("1", "-0.4000"),
        ("2", "-0.1000"),
    ]
    rows = [line.split() for line in again.splitlines()[2:-1]]
    assert rows[0] == ["pretrained-paper", "-0.5000", "20.00", "0"]
    names = ["defaults", "by hand", "trial 2", "trial 0"]  # the best first, trial 1 not at all
    assert [" ".join(row[:-4]) for row in rows[1:]] == names * 3
    assert [row[-4] for row in rows[1:]] == ["1"] * 4 + ["2"] * 4 + ["mean"] * 4
    assert rows[11][2:] == ["mean", "-0.1000", "21.50", "3"]  # speeds 21 and 22, hits 1 and 2


def test_the_hyperparameters_that_ship_are_the_best_of_the_committed_search() -> None:
    printed = (ROOT / "docs" / "results" / "rl_zoo3.txt").read_text(encoding="utf-8")
    searched, again = printed.split("\n\n")
    found = re.findall(r"^(by hand|trial \d+) +mean +(-0\.\d+)", again, re.MULTILINE)
    best = max(found, key=lambda row: float(row[1]))[0]
    trials = draw(len(re.findall(r"^ +\d+  -", searched, re.MULTILINE)))
    for number, trial in enumerate(trials):  # the committed trials are those that it draws today
        shown = re.search(rf"^ +{number}  -\S+ \S+ +\d+  (.*)", searched, re.MULTILINE)
        assert shown
        assert [float(word) for word in shown[1].split()] == [*trial.values()]
    drawn = {} if best == "by hand" else trials[int(best.removeprefix("trial "))]
    text = (ROOT / "examples" / "rl_zoo3.yml").read_text(encoding="utf-8")
    shipped = yaml.safe_load(text)["drl_av/Highway-v0"]
    assert (shipped.pop("n_timesteps"), shipped.pop("policy")) == (20_000, "MlpPolicy")
    assert shipped.pop("policy_kwargs") == "dict(net_arch=[100, 100])"
    assert shipped == {name: (BY_HAND | drawn)[name] for name in BY_HAND if name in shipped}
    assert shipped.keys() | {"policy_kwargs"} == BY_HAND.keys() >= RANGES.keys()
