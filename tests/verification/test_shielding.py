"""Masking, replacement, and replacement with a penalty: what a training records and reports."""

import csv
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from decisions import decided
from runs import Capsys

from drl_av.driving.actions import ACTIONS
from drl_av.env.highway import HighwayEnv
from drl_av.safety.check import Rule, Verdict
from verification import shielding
from verification.shielding import Decided, PenalizedReward, greedy, main
from verification.shielding_report import COLUMNS, over_seeds, section, table

ACCELERATE, HARD_BRAKE = 1, 3


def test_a_refused_action_costs_the_agent_the_penalty_but_not_the_record() -> None:
    reward = PenalizedReward(0.5)
    refused = decided(executed=HARD_BRAKE, proposed=ACCELERATE, reward=-0.1)
    assert reward(refused) == pytest.approx(-0.6)
    assert reward(decided(executed=ACCELERATE, reward=-0.2)) == pytest.approx(-0.2)
    assert reward.decided == [Decided(-0.1, 20.0, True, False), Decided(-0.2, 20.0, False, False)]


class Eager:
    """An agent that would always accelerate, and takes the first permitted action otherwise."""

    def predict(self, observation, action_masks, deterministic):
        assert deterministic
        free = action_masks is None or action_masks[ACCELERATE]
        return (ACCELERATE if free else int(np.flatnonzero(action_masks)[0])), None


def only_braking(scene, proposed):
    action = ACTIONS[HARD_BRAKE]
    return Verdict(action, Rule.NONE if proposed == action else Rule.IN_LANE)


@pytest.mark.parametrize(("masking", "chosen"), [(True, HARD_BRAKE), (False, ACCELERATE)])
def test_only_a_masked_agent_knows_what_the_check_permits(masking: bool, chosen: int) -> None:
    with closing(HighwayEnv(safety_check=only_braking)) as env:
        observation, _ = env.reset(seed=930_000, options={"vehicles": 2})
        assert greedy(Eager(), env, masking).act(env.scene, observation) == ACTIONS[chosen]


def row(method: str, seed: int, step: int, reward: float, refused: float) -> dict[str, str]:
    numbers = {"mean_reward": reward, "mean_speed_m_s": 25.0, "refused_share": refused}
    place = {"method": method, "seed": seed, "stage": "training", "step": step, "ego_hits": 0}
    return {name: str(value) for name, value in {**place, **numbers}.items()}


def test_the_interval_is_over_trainings_not_over_rows() -> None:
    rows = [row("masking", 0, 1, -0.2, 0), row("masking", 0, 2, -0.4, 0)]
    rows += [row("masking", 1, 1, -0.5, 0), row("masking", 1, 2, -0.5, 0)]
    # trainings' means -0.3 and -0.5; standard error 0.1, t(0.975, 1) = 12.706
    mean = over_seeds(rows, "mean_reward")
    assert (mean.value, mean.half_width) == (pytest.approx(-0.4), pytest.approx(1.2706, rel=1e-4))


def test_the_table_states_refused_actions_in_percent() -> None:
    rows = [row("replacement", seed, 1, -0.1, 0.25) for seed in (0, 1)]
    assert table(rows).splitlines()[2:] == [
        "| replacement | training | 2 | -0.100 ± 0.000 | 25.00 ± 0.00 | 25.00 ± 0.00 | 0 |"
    ]


def test_the_documentation_shows_what_is_there(tmp_path: Path) -> None:
    assert section(tmp_path) == "*The trainings have not been made yet.*"
    # two trainings of one method: a line a stage that states how many there are
    rows = [row("masking", seed, 5000, reward, 0.0) for seed, reward in ((0, -0.2), (1, -0.4))]
    rows += [{**each, "stage": "final", "step": "10", "ego_hits": "1"} for each in rows]
    with (tmp_path / "shielding.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    lines = section(tmp_path).splitlines()
    # mean -0.3, standard error 0.1, t(0.975, 1) = 12.706
    assert lines[2:] == [
        "| masking | training | 2 | -0.300 ± 1.271 | 25.00 ± 0.00 | 0.00 ± 0.00 | 0 |",
        "| masking | final | 2 | -0.300 ± 1.271 | 25.00 ± 0.00 | 0.00 ± 0.00 | 2 |",
    ]


def test_a_training_is_made_once_and_a_masked_agent_is_refused_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setattr(shielding, "BIN", 64)
    monkeypatch.setattr(shielding, "SETTINGS", {"n_steps": 64, "n_epochs": 1})
    monkeypatch.setattr(shielding, "DENSITIES", (2,))
    out = tmp_path / "shielding.csv"
    words = ["--seeds", "1", "--steps", "64", "--episodes", "1", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", ["shielding.py", "--methods", "masking", *words])
    assert main() == 0
    first = out.read_bytes()
    [training, final] = csv.DictReader(first.decode().splitlines())
    assert (training["stage"], training["refused_share"]) == ("training", "0.0")
    assert (final["stage"], final["refused_share"]) == ("final", "0.0")
    assert main() == 0
    assert out.read_bytes() == first
    assert out.with_suffix(".png").is_file()
    monkeypatch.setattr(sys, "argv", [*sys.argv, "--steps", "128"])
    with pytest.raises(SystemExit):
        main()
    assert "made with other --steps" in capsys.readouterr().err
