"""Lane changes on the steering plant: the same decisions, driven as a vehicle can drive them."""

import itertools
import math
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles.plan import next_lane_change
from worlds import CENTER, LANE_M, LEFT, RIGHT, ROAD, after, drive, lateral_positions, scene

from drl_av.config import EgoConfig, SimulationConfig
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.maneuver import plan
from drl_av.driving.scene import LaneChange
from drl_av.road.road import holds, is_open

STEERED, KINEMATIC = EgoConfig(lateral_plant="steering"), EgoConfig()
KEEP, TO_RIGHT, TO_LEFT = Lateral.KEEP, Lateral.RIGHT, Lateral.LEFT
MAINTAIN = Longitudinal.MAINTAIN
STEP_LENGTHS = [1.0, 0.5, 0.2, 0.1]
steer = partial(drive, ego=STEERED)


@pytest.mark.parametrize("step_s", STEP_LENGTHS)
@pytest.mark.parametrize("speed", [5.0, 15.0, 30.0])
def test_a_lane_change_takes_5_s_along_a_cubic_and_ends_on_the_centre(
    speed: float, step_s: float
) -> None:
    worlds = steer(scene(speed_m_s=speed), TO_LEFT, *[KEEP] * 5, step_s=step_s)
    cubic = [CENTER + LANE_M * (3 * s**2 - 2 * s**3) for s in (0.2, 0.4, 0.6, 0.8, 1.0)]
    assert lateral_positions(worlds) == pytest.approx([*cubic, LEFT], abs=0.02)
    assert lateral_positions(worlds)[4] == LEFT  # exactly, to the last bit
    assert [world.lane_change is None for world in worlds] == [False] * 4 + [True] * 2
    drifts = [float(world.snapshot.lateral_speed_m_s[0]) for world in worlds]
    # 6 W s (1 - s) / T: not the constant 0.76 m/s of the point mass
    assert drifts == pytest.approx([0.7296, 1.0944, 1.0944, 0.7296, 0, 0], abs=0.02)


@pytest.mark.parametrize("away", [1, 2, 3, 4])
@pytest.mark.parametrize("side", [TO_LEFT, TO_RIGHT])
def test_an_abort_turns_within_a_second_and_ends_on_the_centre_it_came_from(
    side: Lateral, away: int
) -> None:
    opposite = TO_RIGHT if side is TO_LEFT else TO_LEFT
    there = steer(scene(speed_m_s=20.0), side, *[KEEP] * (away - 1))
    back = steer(there[-1], opposite, *[KEEP] * 6)
    assert back[0].snapshot.lateral_speed_m_s[0] * side.sign < 0
    running = [world.lane_change for world in back]
    # it has to stop drifting away first: one or two seconds more than it had been away
    assert away + 1 <= running.index(None) + 1 <= away + 2
    assert lateral_positions(back)[-1] == CENTER
    farthest = max(abs(y_m - CENTER) for y_m in lateral_positions([*there, *back]))
    assert farthest < LANE_M
    assert all(change[:2] == (1 + side.sign, 1) for change in running if change)


def test_the_heading_is_that_of_the_two_speeds() -> None:
    [world] = steer(scene(speed_m_s=20.0), TO_LEFT)
    drift = float(world.snapshot.lateral_speed_m_s[0])
    assert math.tan(world.lane_change.heading_rad) == pytest.approx(drift / 20.0)
    assert world.lane_change.reversed().heading_rad == world.lane_change.heading_rad


def test_an_ego_that_stops_halfway_stays_there_and_continues_where_it_headed() -> None:
    standing = scene(y_m=5.7, v_y=0.0, speed_m_s=0.0, lane_change=LaneChange(1, 2, heading_rad=0.3))
    [still] = steer(standing, KEEP)
    assert (lateral_positions([still]), still.lane_change) == ([5.7], LaneChange(1, 2, 0.3))
    going = plan(still, Action(KEEP, Longitudinal.ACCELERATE), STEERED, SimulationConfig())
    # first SUMO step: 1 m/s for half a second at about 0.3 rad
    assert going.commands[0].y_m == pytest.approx(5.7 + 0.5 * math.tan(0.3), abs=0.02)


def test_a_standing_ego_starts_no_sideways_motion_but_the_point_mass_does() -> None:
    standing, action = scene(speed_m_s=0.0), Action(TO_LEFT, MAINTAIN)
    assert plan(standing, action, STEERED, SimulationConfig()).commands[-1].y_m == CENTER
    assert plan(standing, action, KINEMATIC, SimulationConfig()).commands[-1].y_m > CENTER


DECISIONS = st.lists(
    st.tuples(st.sampled_from(Lateral), st.sampled_from(Longitudinal)), min_size=1, max_size=30
)


@given(decisions=DECISIONS, speed=st.floats(0, 30), step_s=st.sampled_from(STEP_LENGTHS))
def test_whatever_is_decided_the_ego_stays_on_the_road(
    decisions: list[tuple[Lateral, Longitudinal]], speed: float, step_s: float
) -> None:
    world, simulation = scene(speed_m_s=speed), SimulationConfig(step_length_s=step_s)
    for lateral, how in decisions:
        change = next_lane_change(world.lane_change, world.affordances.lane, lateral)
        if change is not None and not is_open(change.target, ROAD):
            lateral, change = KEEP, world.lane_change
        done = plan(world, Action(lateral, how), STEERED, simulation)
        ways = [float(world.snapshot.y_m[0]), *(command.y_m for command in done.commands)]
        for (before, y_m), command in zip(itertools.pairwise(ways), done.commands, strict=True):
            assert holds(y_m, 1.8, 0.0, ROAD)
            # the cubic's steepest slope is 1.5 * 3.8 / 10.677, 28 degrees; settling adds 0.019 m
            assert abs(y_m - before) <= command.speed_m_s * step_s * 0.554 + 0.0191
        end, running = done.commands[-1], done.lane_change
        if running is None:
            assert end.y_m in (RIGHT, CENTER, LEFT)
            assert end.lateral_speed_m_s == 0
        else:
            assert running[:2] == change[:2]
            # readable from position and velocity, from 5 m/s on: it moves where it is going
            assert end.speed_m_s < 5 or end.lateral_speed_m_s * running.sign > 0
            low, high = sorted(running[:2])
            assert low * LANE_M - 0.15 <= end.y_m <= high * LANE_M + 0.15
        world = after(done)
