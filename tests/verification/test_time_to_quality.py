"""How long the agents train until they drive well: the table, and the making of its rows."""

import ast
import math
import sys
from pathlib import Path

import pytest
import yaml

from studies.experiment import ResultsFolder
from tools.tune_rl_zoo3 import BY_HAND, draw
from verification import time_to_quality
from verification.time_to_quality import COLUMNS, QUALITIES, TABLE, kept_s, main, section

ROOT = Path(__file__).parents[2]
NEVER = "never (never to never)"


def run(agent: str, seed: int, *checkpoints: tuple[float, float, float, float]) -> str:
    """The rows of a training; a checkpoint has CPU seconds, speed, reward and triggers."""
    return "".join(
        f"{agent},{seed},{number},{','.join(map(str, values))},0\n"
        for number, values in enumerate(checkpoints, start=1)
    )


def test_a_quality_counts_from_where_it_is_kept() -> None:
    speeds = {10.0: 20.0, 20.0: 12.0, 30.0: 19.0, 40.0: 21.0}
    rows = [{"cpu_s": str(cpu_s), "speed": str(speed)} for cpu_s, speed in speeds.items()]
    assert kept_s(rows, "speed", 19.0, origin=0.0) == 30.0
    assert kept_s(rows, "speed", 12.0, origin=0.0) == 10.0
    assert kept_s(rows, "speed", 22.0, origin=0.0) == math.inf
    assert kept_s(rows, "speed", 20.5, origin=50.0) == math.inf  # smaller is better
    assert kept_s(rows, "speed", 21.0, origin=50.0) == 10.0


def test_thresholds_lie_between_the_random_driver_and_the_final_drivers_of_fast(
    tmp_path: Path,
) -> None:
    assert "not been made" in section(ResultsFolder(tmp_path))
    rows = run("random", 0, (0, 0, -1, 100))
    rows += run("fast", 0, (1, 17, -0.5, 40), (2, 20, 0, 0))
    rows += run("dqn", 0, (3, 18, -0.05, 90), (6, 19.9, 0, 50))
    rows += run("qrdqn", 0, (9, 10, -1, 100))
    (tmp_path / TABLE).write_text(",".join(COLUMNS) + "\n" + rows)
    lines = [
        line.strip("| ").split(" | ") for line in section(ResultsFolder(tmp_path)).splitlines()[2:]
    ]
    assert lines[:5] == [
        ["90%: mean speed, m/s 18.00", "2 (2 to 2)", "3 (3 to 3)", NEVER],
        ["90%: reward per decision -0.100", "2 (2 to 2)", "3 (3 to 3)", NEVER],
        ["90%: safety triggers an episode 10.0", "2 (2 to 2)", NEVER, NEVER],
        ["90%: all three", "2 (2 to 2)", NEVER, NEVER],
        ["99%: mean speed, m/s 19.80", "2 (2 to 2)", "6 (6 to 6)", NEVER],
    ]
    assert lines[8:] == [
        ["the whole training", "2 (2 to 2)", "6 (6 to 6)", "9 (9 to 9)"],
        ["final mean speed, m/s", "20.00", "19.90", "10.00"],
        ["final reward per decision", "0.000", "0.000", "-1.000"],
        ["final safety triggers an episode", "0.0", "50.0", "100.0"],
    ]


def test_its_dqn_has_the_hyperparameters_of_the_example() -> None:
    [zoo] = yaml.safe_load((ROOT / "examples" / "rl_zoo3.yml").read_text()).values()
    settings = BY_HAND | draw(time_to_quality.TRIAL + 1)[time_to_quality.TRIAL]
    nets = settings.pop("policy_kwargs")
    [net_arch] = ast.parse(zoo["policy_kwargs"], mode="eval").body.keywords  # type: ignore[attr-defined]
    assert nets == {net_arch.arg: ast.literal_eval(net_arch.value)}
    assert settings == {name: float(zoo[name]) for name in settings}


def test_a_training_is_made_once_and_early_checkpoints_are_no_copies_of_the_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in {"CHECKPOINTS": 2, "EPISODES": 3, "DENSITIES": (3,), "DRIVES": 1}.items():
        monkeypatch.setattr(time_to_quality, name, value)
    monkeypatch.setattr(sys, "argv", ["", "--seeds", "1", "--out", str(tmp_path)])
    assert main() == 0
    before = (tmp_path / TABLE).read_bytes()
    rows = ResultsFolder(tmp_path).rows(TABLE)
    assert [row["agent"] for row in rows] == [
        "random",
        *("fast", "fast", "dqn", "dqn", "qrdqn", "qrdqn"),
    ]
    for early, late in (rows[1:3], rows[3:5], rows[5:7]):
        assert float(early["cpu_s"]) < float(late["cpu_s"])
        assert [early[name] for name in QUALITIES] != [late[name] for name in QUALITIES]
    assert main() == 0
    assert (tmp_path / TABLE).read_bytes() == before
