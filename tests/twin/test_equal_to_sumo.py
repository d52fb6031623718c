"""The twin drives the episodes of SUMO: the same traffic, indicators, masks, rewards and ends."""

from typing import Any

import numpy as np
import pytest

from drl_av.config.presets import as_config
from drl_av.driving.affordances import INDICATORS
from drl_av.env.highway import HighwayEnv
from drl_av.env.vector import TwinVectorEnv

TRUCKS = {"kind": "calm", "truck_share": 0.5, "truck_length_m": 25.0, "truck_width_m": 1.8}
WIDE = TRUCKS | {"truck_share": 1.0, "truck_length_m": 5.0, "truck_width_m": 2.5}
EAGER = {"kind": "calm", "speed_gain_min": 20.0, "speed_gain_max": 20.0}
CLOSE = (
    ("calm", 20, 930_018),  # a driver has expected a slower lane on its left for long
    ("overtaking", 25, 930_007),  # one enters before the ego, which brakes
    ("overtaking", 25, 930_010),  # one stays beside the centre as long as its request stands
    # one goes on to one of two faster sides
    *(("overtaking", 25, seed) for seed in (930_034, 930_040, 930_054)),
    ("paper", 20, 930_013),  # one lets another in on its right, where it may go at any time
    ("hazards", 20, 930_012),  # one sees past another that is about to enter its lane
    ("hazards", 20, 930_024),  # vehicles stand in a queue
)
# 1001 and 1003 among 20: requested lane changes, drivers that make room, others that move right
# because they may not pass on the right, and bodies that rest between two lanes


@pytest.mark.parametrize(
    ("traffic", "scenario", "check", "vehicles", "seed", "decisions"),
    [
        ("calm", "circular_three_lane", "paper", 5, 1000, 200),
        ("calm", "circular_three_lane", "paper", 20, 1001, 200),
        ("calm", "circular_three_lane", "paper", 20, 1003, 200),
        ("calm", "circular_three_lane", "strict", 20, 1004, 60),
        ("calm", "circular_three_lane", "permit_all", 30, 1001, 200),
        ("calm", "barricaded_right_lane", "paper", 14, 1002, 100),
        ("naturalistic", "circular_three_lane", "paper", 20, 930_000, 200),
        ("paper", "circular_three_lane", "paper", 20, 930_002, 200),
        ("hazards", "circular_three_lane", "paper", 20, 930_006, 200),
        *((kind, "circular_three_lane", "paper", number, seed, 60) for kind, number, seed in CLOSE),
        (TRUCKS, "circular_three_lane", "permit_all", 15, 1_000_001, 10),
        (WIDE, "circular_three_lane", "strict", 20, 931_018, 25),
        (EAGER, "circular_three_lane", "paper", 20, 931_003, 60),
    ],
)
def test_an_episode_is_the_same_as_in_sumo(
    traffic: str | dict[str, Any],
    scenario: str,
    check: str,
    vehicles: int,
    seed: int,
    decisions: int,
) -> None:
    config = as_config({"traffic": {"kind": traffic} if isinstance(traffic, str) else traffic})
    with HighwayEnv(scenario, check, config, action_mask=True) as sumo:
        twin = TwinVectorEnv(1, scenario, check, config)
        start = {"seed": seed, "options": {"vehicles": vehicles}}
        seen, info = sumo.reset(**start)  # type: ignore[arg-type]
        seen_there, there = twin.reset(**start)  # type: ignore[arg-type]
        draws = np.random.default_rng(seed)
        over, decision = False, 0
        while not over and decision < decisions:
            assert seen_there[0] == pytest.approx(seen, abs=1e-5), decision
            both = zip(sumo.scene.snapshot.arrays, twin.scene(0).snapshot.arrays, strict=True)
            assert all(np.allclose(*pair, rtol=0.0, atol=1e-6) for pair in both), decision
            assert_equal_info(info, there)
            permitted = np.flatnonzero(info["action_mask"])
            action = 1 if info["action_mask"][1] else 0 if info["action_mask"][0] else 2
            if draws.random() < 0.3 and len(permitted):
                action = int(draws.choice(permitted))
            seen, reward, *ends, info = sumo.step(action)
            seen_there, reward_there, *ends_there, there = twin.step(np.array([action]))
            assert reward_there[0] == pytest.approx(reward, abs=1e-6)
            assert [bool(end[0]) for end in ends_there] == ends
            over, decision = any(ends), decision + 1


def assert_equal_info(info: dict, there: dict) -> None:  # type: ignore[type-arg]
    assert set(info) == {name for name in there if not name.startswith("_")}
    for name, value in info.items():
        if name == "rewards":
            for term, number in value.items():
                assert there[name][term][0] == pytest.approx(number, abs=1e-6)
        elif name == "indicators":
            wrong = np.flatnonzero(np.abs(there[name][0] - value) > 1e-6)
            assert not [INDICATORS[number] for number in wrong]
        else:
            assert np.all(
                there[name][0] == pytest.approx(value)
                if name in ("speed_m_s", "mean_speed_m_s")
                else there[name][0] == value
            ), name
