"""The checks on plain arrays: the scene of a user's own simulator."""

import math
from contextlib import closing
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS
from drl_av.driving.scene import LaneChange, Scene
from drl_av.errors import ConfigError
from drl_av.safety import action_mask, named_check
from drl_av.safety.check import Rule
from drl_av.safety.paper import Paper
from drl_av.safety.strict import Strict

CONFIG = Config()
PAPER, STRICT = Paper(CONFIG.safety), Strict(CONFIG.strict, CONFIG.ego, CONFIG.simulation)
FAST_LEFT = (-60.0, 7.6, 33.0)
"""A vehicle two lanes to the left of the right lane, which a driver in that lane need not heed."""


def right_lane(speed_m_s: float, gap_m: float, front_m_s: float, **options: Any) -> Scene:
    """The ego at the position -7 m of the right lane behind a vehicle, 5 m long like itself."""
    s_m, y_m, speeds = zip(
        (-7.0, 0.0, speed_m_s), (-7.0 + 5.0 + gap_m, 0.0, front_m_s), FAST_LEFT, strict=True
    )
    return Scene.from_arrays(s_m, y_m, speeds, **options)


def test_the_paper_check_brakes_hard_two_seconds_behind_a_slower_vehicle() -> None:
    # 40 m at 20 m/s: T_C = 2 s; at 40.1 m it is more: brake; rule 3 needs 3 s * 20 m/s + 15 m
    keep, right, left = PAPER.verdicts(right_lane(30.0, 40.0, 10.0)).executed.reshape(3, 4)
    assert keep.tolist() == right.tolist() == left.tolist() == [3, 3, 3, 3]
    later = right_lane(30.0, 40.1, 10.0)
    assert PAPER.verdicts(later).executed[:4].tolist() == [2, 2, 2, 3]
    assert action_mask(PAPER, later).tolist() == [0, 0, 1, 1] + 8 * [0]
    assert PAPER(later, ACTIONS[4]).rule == Rule.IN_LANE | Rule.OFF_ROAD


def test_a_number_counts_for_all_vehicles_and_lengths_shorten_the_gap() -> None:
    width_m = np.array(3.8)  # as np.load returns a number
    truck = Scene.from_arrays([0.0, 60.0], 3.8, 25.0, length_m=[5.0, 15.0], lane_width_m=width_m)
    front = truck.affordances.own_front
    assert (front.gap_m, front.relative_speed_m_s) == (50.0, 0.0)
    seen = truck.affordances
    assert (seen.lane, seen.right_lane, seen.left_lane) == (1, True, True)


def test_the_lanes_are_those_that_are_given() -> None:
    two = Scene.from_arrays([0.0], [4.0], [25.0], lanes=2, lane_width_m=4.0)
    left, right = ACTIONS[8], ACTIONS[4]
    assert PAPER(two, left).rule == Rule.OFF_ROAD
    assert PAPER(two, right).action == right


def test_a_lane_change_in_progress_may_be_aborted() -> None:
    # beside a vehicle in the left lane, the ego goes back whatever it proposes
    beside = {"s_m": [0.0, 1.0], "y_m": [1.0, 3.8], "speed_m_s": 20.0}
    changing = Scene.from_arrays(**beside, lane_change=LaneChange(0, 1))
    keep, back = ACTIONS[0], ACTIONS[4]
    for check in (PAPER, STRICT):
        assert check(changing, keep).action.lateral == back.lateral
        assert check(Scene.from_arrays(**beside), keep).action == keep


@given(st.floats(-1e5, 1e5), st.integers(0, 2), st.lists(st.floats(0, 40), min_size=2, max_size=6))
def test_the_origin_of_the_positions_does_not_matter(
    origin_m: float, lane: int, speeds: list[float]
) -> None:
    s_m = 17.0 * np.arange(len(speeds))
    lanes = np.array([lane, *(each % 3 for each in range(len(speeds) - 1))])
    here, there = (Scene.from_arrays(at, 3.8 * lanes, speeds) for at in (s_m, s_m + origin_m))
    assert PAPER.verdicts(here).executed.tolist() == PAPER.verdicts(there).executed.tolist()


def test_the_arrays_of_an_episode_in_sumo_give_the_verdicts_of_the_environment() -> None:
    env = gymnasium.make("drl_av/Straight-v0", safety_check="strict")
    check, seen = named_check(Config().updated("safety", check="strict")), set()
    with closing(env):
        env.reset(seed=4)
        rng = np.random.default_rng(4)
        for _ in range(40):
            scene, road = env.unwrapped.scene, env.unwrapped.road  # type: ignore[attr-defined]
            arrays = scene.snapshot.arrays
            lanes = {"lanes": len(road.open_lanes), "lane_width_m": road.lane_width_m}
            ours = Scene.from_arrays(*arrays, **lanes, lane_change=scene.lane_change)
            for judge in (PAPER, check):
                expected, found = judge.verdicts(scene), judge.verdicts(ours)  # type: ignore[attr-defined]
                assert found.executed.tolist() == expected.executed.tolist()
                assert found.rules.tolist() == expected.rules.tolist()
                seen.update(found.rules.tolist())
            *_, terminated, truncated, _ = env.step(int(rng.choice([0, 1, 5, 9])))
            if terminated or truncated:
                break
    assert len(seen) > 3


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"s_m": [0.0, 50.0, 90.0]}, "do not fit together"),
        ({"s_m": [[0.0, 50.0]]}, r"shape \(1, 2\)"),
        ({"y_m": 3.8, "s_m": 7.0, "speed_m_s": 20.0}, r"shape \(\)"),
        ({"speed_m_s": [20.0, np.nan]}, "nan or inf"),
        ({"y_m": [-4.0, 0.0]}, "3 lanes of 3.8 m cannot have the ego at y_m = -4 .*left positive"),
        ({"lanes": 1}, "1 lanes of 3.8 m cannot have the ego at y_m = 3.8"),
        ({"s_m": ["here", 50.0]}, "do not fit together .*could not convert"),
        ({"s_m": [], "y_m": [], "speed_m_s": []}, r"shape \(0,\)"),
        ({"length_m": [5.0, -50.0]}, "smallest size -50 m"),
        ({"width_m": 0.0}, "smallest size 0 m.*width_m above 0"),
        ({"lane_width_m": -3.8}, "3 lanes of -3.8 m cannot"),
        ({"lane_width_m": 0.0}, "3 lanes of 0.0 m cannot"),
        ({"lane_width_m": math.nan}, "3 lanes of nan m cannot"),
        ({"lanes": 2.5}, "2.5 lanes of 3.8 m cannot"),
        ({"lanes": -1}, "-1 lanes of 3.8 m cannot"),
        ({"lanes": None}, "None lanes of 3.8 m cannot"),
        ({"lane_change": LaneChange(0, 7)}, r"origin=0, target=7.*between its lane and the next"),
        ({"lane_change": LaneChange(2, 3)}, "origin=2, target=3"),
        ({"lane_change": LaneChange(0, 2)}, "origin=0, target=2"),
        ({"lane_change": LaneChange(0, 1), "y_m": 7.6}, "y_m = 7.6 with .*origin=0, target=1"),
        ({"lane_change": LaneChange(0, -1)}, "origin=0, target=-1"),
        ({"lane_change": (0, 1, 0.0)}, r"with lane_change \(0, 1, 0.0\)"),
        ({"lane_change": LaneChange(0.0, 1.0)}, r"origin=0\.0, target=1\.0"),  # type: ignore[arg-type]
        ({"lane_width_m": "wide"}, "3 lanes of 'wide' m cannot"),
    ],
)
def test_arrays_that_are_no_scene_are_refused(wrong: dict[str, Any], reason: str) -> None:
    good = {"s_m": [0.0, 50.0], "y_m": [3.8, 3.8], "speed_m_s": [20.0, 20.0]}
    with pytest.raises(ConfigError, match=reason):
        Scene.from_arrays(**(good | wrong))
