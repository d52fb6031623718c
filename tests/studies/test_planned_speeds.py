"""Speeds planned on the reward itself: what they are, worked by hand and by brute force."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import CENTER, LEFT, RIGHT, ahead, behind, scene

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal, toward
from drl_av.driving.counterfactual import motion
from drl_av.driving.maneuver import LaneChange, Scene
from drl_av.driving.reward import desired, rewards
from drl_av.studies.planned_speeds import PlannedSpeeds

CONFIG = Config()


class Changer:
    """Hard brakes, and changes lanes as it is told."""

    def __init__(self, lateral: Lateral = Lateral.KEEP) -> None:
        self.lateral = lateral
        self.seed = -1

    def start(self, seed: int) -> None:
        self.seed = seed

    def act(self, scene: Scene, observation: np.ndarray) -> Action:
        return Action(self.lateral, Longitudinal.HARD_BRAKE)


def planned(scene: Scene, horizon: int, lateral: Lateral = Lateral.KEEP) -> Action:
    return PlannedSpeeds(Changer(lateral), CONFIG, horizon).act(scene, np.zeros(27, np.float32))


@pytest.mark.parametrize(
    ("at", "speed", "best"),
    [
        (scene(behind(30.0), ahead(40.0, RIGHT, 5.0)), 20.0, Longitudinal.ACCELERATE),
        # at d_safe = 1.3 s * 20 m/s behind one as fast: nothing to win
        (scene(ahead(26.0)), 20.0, Longitudinal.MAINTAIN),
        # 50 m further the lane allows 20 + 50 / 8 = 26.25 m/s
        (scene(ahead(76.0)), 20.0, Longitudinal.ACCELERATE),
        # at 24 m/s: 20 m/s after a hard brake, and 26 + 20 - 21 = 25 m of 26 m;
        # 22 m/s after a brake: r_v = exp(-0.4) - 1
        (scene(ahead(26.0), speed_m_s=24.0), 24.0, Longitudinal.HARD_BRAKE),
    ],
)
@pytest.mark.parametrize("horizon", [1, 4])
def test_it_holds_the_speed_that_the_lane_allows(
    at: Scene, speed: float, best: Longitudinal, horizon: int
) -> None:
    assert at.seen.ego_speed_m_s == speed
    assert planned(at, horizon) == Action(Lateral.KEEP, best)


def test_who_comes_into_the_other_lane_within_the_second_looks_at_the_vehicle_there() -> None:
    # 0.4 m from the line at 0.76 m/s: there in 0.53 s, or in 1.18 s with 0.9 m to go
    over, not_yet = CENTER + 1.5, CENTER + 1.0
    for y_m, lateral, best in (
        (over, Lateral.KEEP, Longitudinal.ACCELERATE),
        (over, Lateral.LEFT, Longitudinal.ACCELERATE),
        (over, Lateral.RIGHT, Longitudinal.HARD_BRAKE),  # turns back
        (not_yet, Lateral.LEFT, Longitudinal.HARD_BRAKE),
    ):
        at = scene(ahead(20.0, CENTER, 10.0), y_m=y_m, lane_change=LaneChange(1, 2))
        assert planned(at, 1, lateral) == Action(lateral, best)
    beyond = scene(ahead(20.0, LEFT, 10.0), y_m=CENTER + 2.0, lane_change=LaneChange(1, 2))
    assert planned(beyond, 1).longitudinal is Longitudinal.HARD_BRAKE


def best_return(at: Scene, gap_m: float, leader_m_s: float, horizon: int) -> float:
    """The greatest return, one decision after the other, with the environment's own functions."""
    return max(
        returned(at, gap_m, leader_m_s, action, horizon)
        for action in ACTIONS
        if action.lateral == toward(0)
    )


def returned(at: Scene, gap_m: float, leader_m_s: float, action: Action, horizon: int) -> float:
    """What an action brings, and the best that can come after it."""
    made = motion(at, action, CONFIG)
    gap_m += leader_m_s - made.distance_m
    after = scene(ahead(gap_m, CENTER, leader_m_s), speed_m_s=made.speed_m_s)
    target = desired(after.seen, CONFIG.reward, CONFIG.safety)
    terms = rewards(after.seen, target, CONFIG.reward, CONFIG.safety.minimum_gap_m)
    later = best_return(after, gap_m, leader_m_s, horizon - 1) if horizon > 1 else 0.0
    return terms.r_v + terms.r_x + CONFIG.learning.discount * later


@given(
    speed=st.floats(0.0, 30.0),
    gap_m=st.floats(61.0, 185.0),
    leader_m_s=st.floats(0.0, 30.0),
    horizon=st.integers(1, 2),
)
def test_no_sequence_brings_more(
    speed: float, gap_m: float, leader_m_s: float, horizon: int
) -> None:
    at = scene(ahead(gap_m, CENTER, leader_m_s), speed_m_s=speed)
    chosen = returned(at, gap_m, leader_m_s, planned(at, horizon), horizon)
    most = best_return(at, gap_m, leader_m_s, horizon)
    assert math.isclose(chosen, most, rel_tol=1e-9, abs_tol=1e-9)


def test_it_starts_the_driver_whose_lane_changes_it_takes() -> None:
    changer = Changer()
    PlannedSpeeds(changer, CONFIG, 1).start(7)
    assert changer.seed == 7
