"""The preset ``fast`` beside the whole schedule, as an experiment of ``drl-av reproduce``."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from drl_av.config import Config
from drl_av.episode import EpisodeResult
from drl_av.studies.reproduction import fast as module
from drl_av.studies.reproduction.legs import Leg
from drl_av.studies.reproduction.scale import Scale
from drl_av.studies.reproduction.tables import read_rows

SHORT = """
[simulation]
decisions_per_episode = 4
[learning]
episodes = 2
evaluate_every = 1
evaluation_episodes = 1
"""


def test_every_seed_is_trained_and_driven_through_the_traffic_of_the_long_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "DENSITIES", (1, 2))
    short = tmp_path / "short.toml"
    short.write_text(SHORT)
    scale = Scale(
        seeds=2,
        drives=2,
        jobs=1,
        runs=tmp_path / "runs",
        out=tmp_path / "out",
        config=str(short),
    )
    told = list(module.fast(scale))
    assert (told[-1].done, told[-1].total) == (3 * 2 * 2, 3 * 2 * 2)
    rows = read_rows(tmp_path / "out" / "fast.csv")
    assert [(row["training"], row["seed"]) for row in rows] == [
        ("paper", "0"),
        ("fast", "0"),
        ("fast", "1"),
    ]
    assert {row["drives"] for row in rows} == {"4"}
    assert all(float(row["wall_time_s"]) > 0 for row in rows)
    assert (float(rows[0]["mean_reward_gain"]), float(rows[0]["mean_reward_gain_ci95"])) == (0, 0)
    facts = json.loads((tmp_path / "out" / "fast.json").read_text())
    assert list(facts["policies_sha256"]) == ["paper-0", "fast-0", "fast-1"]
    again = list(module.fast(scale))
    assert {progress.told for progress in again} == {"training"}
    more = list(module.fast(scale._replace(drives=3)))
    assert more[-1].total == 3 * 2 * 3


def test_gains_are_paired_by_the_traffic(tmp_path: Path) -> None:
    base = EpisodeResult(
        driver="fast-3",
        safety_check="paper",
        vehicles=5,
        seed=0,
        decisions=200,
        mean_speed_m_s=0.0,
        mean_reward=0.0,
        mean_r_v=0.0,
        mean_r_y=0.0,
        mean_r_x=0.0,
        collided=False,
        ego_hit=False,
        collision="",
        safety_triggers=0,
        lane_changes=0,
        aborted_lane_changes=0,
        min_ttc_s=1.0,
        min_headway_s=1.0,
        hard_brakes=0,
        d_safe_violations=0,
    )
    driven = [replace(base, mean_speed_m_s=v, mean_reward=-0.1) for v in (30.0, 21.0, 12.0)]
    driven[2] = replace(driven[2], collided=True, ego_hit=True)
    long = [replace(base, mean_speed_m_s=v, mean_reward=-0.2) for v in (28.0, 20.0, 9.0)]
    leg = Leg("fast", 3, 200, Config(), tmp_path / "fast-3", 100)
    leg.clock.write_text("100,40.5\n200,50.0\n")
    row = module.summary(leg, driven, long)
    # 2, 1 and 3 m/s faster: mean 2, standard error 1 / sqrt(3), t(0.975, 2) = 4.3027.
    assert float(row["mean_speed_m_s_gain"]) == pytest.approx(2)
    assert float(row["mean_speed_m_s_gain_ci95"]) == pytest.approx(4.3027 / 3**0.5, abs=1e-3)
    assert float(row["mean_reward_gain"]) == pytest.approx(0.1)
    assert (row["ego_hits"], row["wall_time_s"], row["seed"]) == ("1", "90.5", "3")
