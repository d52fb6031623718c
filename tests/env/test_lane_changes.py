"""Lane changes of the ego in SUMO."""

import numpy as np
import pytest
from drives import KEEP, LEFT, RIGHT, Place, start, y_m
from worlds import LANE_M

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS
from drl_av.driving.scene import LaneChange
from drl_av.env.highway import HighwayEnv
from drl_av.scenarios.folder import PlacedVehicle


@pytest.mark.parametrize("step_length_s", [0.5, 0.2])
def test_a_lane_change_moves_0_76_m_in_each_second_and_ends_exactly_on_the_centre(
    step_length_s: float,
) -> None:
    with HighwayEnv(config=Config().updated("simulation", step_length_s=step_length_s)) as made:
        for seed in range(3):
            start(made, 0, seed)
            origin = made.scene.affordances.lane
            side = LEFT if origin < 2 else RIGHT
            sign = ACTIONS[side].lateral.sign
            for second in range(1, 6):
                _, _, _, _, info = made.step(side if second == 1 else KEEP)
                assert y_m(made) == pytest.approx(origin * LANE_M + sign * 0.76 * second, abs=1e-9)
                assert info["indicators"][26] == pytest.approx(0.76 * sign if second < 5 else 0)
            assert y_m(made) == pytest.approx((origin + sign) * LANE_M, abs=1e-12)
            assert made.scene.lane_change is None
            made.step(KEEP)
            assert y_m(made) == pytest.approx((origin + sign) * LANE_M, abs=1e-12)


def test_a_slow_ego_changes_lanes_within_a_second_if_that_is_set() -> None:
    limits = {"lane_change_duration_s": 1.0, "max_speed_m_s": 1.0}
    with HighwayEnv(config=Config().updated("ego", **limits)) as made:
        start(made, 0)
        lane = made.scene.affordances.lane
        made.step(LEFT if lane < 2 else RIGHT)
        assert y_m(made) == pytest.approx((lane + 1 if lane < 2 else 1) * LANE_M, abs=1e-9)


@pytest.mark.parametrize("away", [1, 2, 3, 4])
def test_a_lane_change_can_be_aborted_in_each_second(env: HighwayEnv, away: int) -> None:
    start(env, 0)
    origin = env.scene.affordances.lane
    there, back = (LEFT, RIGHT) if origin < 2 else (RIGHT, LEFT)
    sign = ACTIONS[there].lateral.sign
    ways = []
    for action in (there, *[KEEP] * (away - 1), back, *[KEEP] * (away - 1)):
        env.step(action)
        ways.append((y_m(env) - origin * LANE_M) * sign / 0.76)
    assert ways == pytest.approx([*range(1, away + 1), *range(away - 1, -1, -1)], abs=1e-9)
    assert y_m(env) == pytest.approx(origin * LANE_M, abs=1e-12)
    assert env.scene.lane_change is None


def test_lane_changes_across_the_seam_and_every_edge_of_the_loop_are_no_different(
    place: Place,
) -> None:
    # at 30 m/s the ego passes all four edges, and the seam, in the middle of lane changes
    made = place(PlacedVehicle("ego", 0, 20.0, 30.0, 30.0))
    made.reset(seed=0)
    position_m = made.scene.snapshot.s_m[0]
    for decision in range(40):
        made.step(LEFT if decision % 20 < 10 else RIGHT)
        part = decision % 20 + 1
        expected = 0.76 * part if part <= 10 else 7.6 - 0.76 * (part - 10)
        assert y_m(made) == pytest.approx(expected, abs=1e-9)
        moved_m = (made.scene.snapshot.s_m[0] - position_m) % 500
        assert moved_m == pytest.approx(30.0, abs=1e-6)
        position_m = made.scene.snapshot.s_m[0]


def test_what_is_in_progress_is_readable_from_position_and_velocity(env: HighwayEnv) -> None:
    rng = np.random.default_rng(0)
    start(env, 3)
    for _ in range(150):
        _, _, terminated, _, info = env.step(int(rng.integers(12)))
        assert not terminated
        y, v_y = info["indicators"][25], info["indicators"][26]
        running = env.scene.lane_change
        if running is None:
            assert v_y == 0
            assert y / LANE_M == pytest.approx(round(y / LANE_M), abs=1e-9)
        else:
            right = int(y // LANE_M)
            assert running == LaneChange(*((right, right + 1) if v_y > 0 else (right + 1, right)))
