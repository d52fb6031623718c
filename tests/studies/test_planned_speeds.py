"""Speeds planned on the reward itself: what they are, worked by hand and by brute force."""

from collections.abc import Sequence
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import CENTER, LEFT, LONG_ROAD, RIGHT, Car, ahead, behind, scene

from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, Longitudinal, toward
from drl_av.driving.counterfactual import motion
from drl_av.driving.maneuver import LaneChange, Scene, plan
from drl_av.driving.reward import desired, rewards
from drl_av.studies.planned_speeds import PlannedSpeeds

CONFIG = Config()
HORIZON = 3
GAPS_M = st.floats(91.0, 150.0)
"""More than the ego drives in that time, and 30 m/s further still within its range."""


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


def test_nearer_than_d_safe_costs_r_x_alone_and_nobody_goes_on_past_the_target_lane() -> None:
    near = PlannedSpeeds(Changer(), CONFIG, 1)._returns(scene(ahead(10.0)), Lateral.KEEP)
    # 16 m nearer than d_safe = 26 m: exp(-16^2 / 260) - 1
    assert near[Longitudinal.MAINTAIN] == pytest.approx(-0.62642, abs=1e-5)
    # from the right to 0.76 m short of the centre, with the left lane free
    over = scene(ahead(26.0), y_m=3.04, lane_change=LaneChange(0, 1))
    four = PlannedSpeeds(Changer(), CONFIG, 4)._returns(over, Lateral.KEEP)
    assert four[0] == pytest.approx(0.0, abs=1e-9)  # at the same speed throughout


def returned(at: Scene, lateral: Lateral, sequence: Sequence[Longitudinal]) -> float:
    """What a sequence brings by the environment's own functions, the others at constant speed."""
    now, driven_m, total = at, 0.0, 0.0
    offset_m = at.snapshot.s_m - at.snapshot.s_m[0]
    for number, longitudinal in enumerate(sequence):
        action = Action(Lateral.KEEP if number else lateral, longitudinal)
        made, going = motion(now, action, CONFIG), plan(now, action, CONFIG.ego, CONFIG.simulation)
        driven_m += made.distance_m
        others = (
            Car(offset + speed * (number + 1) - driven_m, y_m, speed)
            for offset, y_m, speed in zip(
                offset_m[1:], at.snapshot.y_m[1:], at.snapshot.speed_m_s[1:], strict=True
            )
        )
        now = scene(
            *others,
            y_m=made.y_m,
            speed_m_s=made.speed_m_s,
            v_y=made.lateral_speed_m_s,
            lane_change=going.lane_change,
            road=LONG_ROAD,
        )
        target = desired(now.seen, CONFIG.reward, CONFIG.safety)
        terms = rewards(now.seen, target, CONFIG.reward, CONFIG.safety.minimum_gap_m)
        total += CONFIG.learning.discount**number * (terms.r_v + terms.r_x)
    return total


@st.composite
def ways(draw: st.DrawFn) -> tuple[Scene, Lateral]:
    """Somebody ahead in every lane, out of reach; a lane change, maybe, and what comes of it."""
    origin = draw(st.integers(0, 2))
    target = draw(st.sampled_from([lane for lane in range(3) if abs(lane - origin) == 1]))
    seconds, sign = draw(st.integers(0, 4)), target - origin
    at = scene(
        *(ahead(draw(GAPS_M), y_m, draw(st.floats(0.0, 30.0))) for y_m in (RIGHT, CENTER, LEFT)),
        y_m=3.8 * origin + 0.76 * sign * seconds,
        speed_m_s=draw(st.floats(0.0, 30.0)),
        v_y=0.76 * sign * bool(seconds),
        lane_change=LaneChange(origin, target) if seconds else None,
        road=LONG_ROAD,
    )
    turned = {toward(-sign)} if seconds else set()
    return at, draw(st.sampled_from(sorted({Lateral.KEEP, toward(sign)} | turned)))


@given(ways())
def test_a_sequence_is_worth_what_the_environment_would_give_for_it(
    way: tuple[Scene, Lateral],
) -> None:
    at, lateral = way
    found = PlannedSpeeds(Changer(), CONFIG, HORIZON)._returns(at, lateral)
    sequences = [*product(Longitudinal, repeat=HORIZON)]
    drawn = range(0, len(sequences), 5)  # 5 and 4 have no common factor: every decision is there
    expected = [returned(at, lateral, sequences[number]) for number in drawn]
    np.testing.assert_allclose(found[drawn], expected, rtol=0.0, atol=1e-9)


def test_it_starts_the_driver_whose_lane_changes_it_takes() -> None:
    changer = Changer()
    PlannedSpeeds(changer, CONFIG, 1).start(7)
    assert changer.seed == 7
