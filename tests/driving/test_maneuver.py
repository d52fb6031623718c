"""Lane changes in progress, and a decision turned into one command a SUMO step."""

import math

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from oracles.plan import next_lane_change
from worlds import (
    CENTER,
    LANE_M,
    LEFT,
    RIGHT,
    ROAD,
    after,
    changing,
    drive,
    lateral_positions,
    scene,
)

from drl_av.config import EgoConfig, SimulationConfig
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.maneuver import next_change, plan
from drl_av.driving.scene import LaneChange
from drl_av.road.road import holds, is_open

EGO, SIMULATION = EgoConfig(), SimulationConfig()
KEEP, TO_RIGHT, TO_LEFT = Lateral.KEEP, Lateral.RIGHT, Lateral.LEFT
MAINTAIN = Longitudinal.MAINTAIN
STEP_LENGTHS = [1.0, 0.5, 0.2, 0.1]


@pytest.mark.parametrize("step_s", STEP_LENGTHS)
def test_a_lane_change_takes_5_s_at_0_76_m_s_and_ends_on_the_centre(step_s: float) -> None:
    worlds = drive(scene(), TO_LEFT, *[KEEP] * 5, step_s=step_s)
    positions = lateral_positions(worlds)
    assert positions == pytest.approx([4.56, 5.32, 6.08, 6.84, 7.6, 7.6])
    assert positions[4] == ROAD.center_m(2)  # exactly, to the last bit
    speeds = [float(world.snapshot.lateral_speed_m_s[0]) for world in worlds]
    assert speeds == pytest.approx([0.76, 0.76, 0.76, 0.76, 0, 0])
    running = [world.lane_change for world in worlds]
    assert running == [LaneChange(1, 2)] * 4 + [None] * 2


def test_the_same_side_again_lets_it_continue_and_then_starts_the_next() -> None:
    worlds = drive(scene(y_m=RIGHT), *[TO_LEFT] * 7)
    assert lateral_positions(worlds) == pytest.approx([0.76, 1.52, 2.28, 3.04, 3.8, 4.56, 5.32])
    assert worlds[-1].lane_change == LaneChange(1, 2)


@pytest.mark.parametrize("step_s", STEP_LENGTHS)
@pytest.mark.parametrize("away", [1, 2, 3, 4])
@pytest.mark.parametrize("side", [TO_LEFT, TO_RIGHT])
def test_an_abort_takes_as_long_as_the_ego_had_been_away(
    side: Lateral, away: int, step_s: float
) -> None:
    opposite = TO_RIGHT if side is TO_LEFT else TO_LEFT
    there = drive(scene(), side, *[KEEP] * (away - 1), step_s=step_s)
    back = drive(there[-1], opposite, *[KEEP] * (away - 1), step_s=step_s)
    assert lateral_positions([*there, *back]) == pytest.approx(
        [CENTER + side.sign * 0.76 * k for k in (*range(1, away + 1), *range(away - 1, -1, -1))]
    )
    assert back[-1].snapshot.y_m[0] == ROAD.center_m(1)
    assert back[-1].lane_change is None
    assert back[-1].snapshot.lateral_speed_m_s[0] == 0
    for world in back[:-1]:
        assert world.lane_change == LaneChange(1 + side.sign, 1)


def test_an_abort_can_be_aborted() -> None:
    worlds = drive(scene(), TO_LEFT, KEEP, TO_RIGHT, TO_LEFT, KEEP, KEEP, KEEP)
    assert lateral_positions(worlds) == pytest.approx([4.56, 5.32, 4.56, 5.32, 6.08, 6.84, 7.6])


def test_steering_decides_what_is_in_progress() -> None:
    keep, right, left = (lateral.sign for lateral in (KEEP, TO_RIGHT, TO_LEFT))
    assert next_change(0, 0, 1, keep) == (1, 1)  # none
    assert next_change(0, 0, 1, left) == (1, 2)
    assert next_change(0, 0, 1, right) == (1, 0)
    assert next_change(1, 2, 1, keep) == (1, 2)
    assert next_change(1, 2, 1, left) == (1, 2)
    assert next_change(1, 2, 1, right) == (2, 1)
    # past the line the lane under the ego is another: what runs does not depend on it
    assert next_change(1, 2, 2, right) == (2, 1)
    assert next_change(1, 2, 2, left) == (1, 2)
    assert [LaneChange(1, 2).sign, LaneChange(1, 2).reversed().sign] == [1, -1]


@pytest.mark.parametrize(
    ("speed", "how", "speeds"),
    [
        (20.0, Longitudinal.MAINTAIN, [20.0, 20.0]),
        (20.0, Longitudinal.ACCELERATE, [21.0, 22.0]),
        *((20.0, Longitudinal.BRAKE, [19.0, 18.0]), (20.0, Longitudinal.HARD_BRAKE, [18.0, 16.0])),
        (29.5, Longitudinal.ACCELERATE, [30.0, 30.0]),
        *((1.0, Longitudinal.BRAKE, [0.0, 0.0]), (3.0, Longitudinal.HARD_BRAKE, [1.0, 0.0])),
    ],
)
def test_speed_follows_the_acceleration_step_by_step_between_standstill_and_30_m_s(
    speed: float, how: Longitudinal, speeds: list[float]
) -> None:
    done = plan(scene(speed_m_s=speed), Action(KEEP, how), EGO, SIMULATION)
    assert [command.speed_m_s for command in done.commands] == speeds


@pytest.mark.parametrize("step_s", STEP_LENGTHS)
def test_a_decision_has_one_command_a_sumo_step(step_s: float) -> None:
    simulation = SimulationConfig(step_length_s=step_s)
    done = plan(scene(), Action(TO_LEFT, Longitudinal.ACCELERATE), EGO, simulation)
    assert len(done.commands) == round(1 / step_s)
    assert done.commands[-1].speed_m_s == pytest.approx(22.0)
    assert done.commands[-1].y_m == pytest.approx(4.56)


def test_a_duration_that_is_no_whole_number_of_decisions_ends_within_one() -> None:
    # 3.8 m in 2.5 s is 1.52 m/s: at 2.5 s the ego is there, and stays
    worlds = drive(scene(), TO_LEFT, KEEP, KEEP, KEEP, ego=EgoConfig(lane_change_duration_s=2.5))
    assert lateral_positions(worlds) == pytest.approx([5.32, 6.84, 7.6, 7.6])
    assert [world.lane_change for world in worlds] == [LaneChange(1, 2)] * 2 + [None] * 2


def test_a_lane_change_is_judged_by_where_the_ego_is_not_by_when_it_began() -> None:
    world = changing(origin=1, target=2, seconds=4)
    done = plan(world, Action(KEEP, MAINTAIN), EGO, SIMULATION)
    assert done.lane_change is None
    assert [command.y_m for command in done.commands] == pytest.approx([7.22, 7.6])


def recovered(y_m: float, v_y: float) -> LaneChange | None:
    """The lane change in progress, from the two indicators alone."""
    if v_y == 0:
        return None
    between = y_m / LANE_M
    right, left = math.floor(between), math.ceil(between)
    return LaneChange(right, left) if v_y > 0 else LaneChange(left, right)


class AnyLateralActions(RuleBasedStateMachine):
    """The ego on an empty road, steered by any actions that do not start off the road."""

    def __init__(self) -> None:
        super().__init__()
        self.world = scene()
        self.decisions_since_rest = 0

    @rule(lateral=st.sampled_from(Lateral), how=st.sampled_from(Longitudinal))
    def decide(self, lateral: Lateral, how: Longitudinal) -> None:
        heading = next_lane_change(self.world.lane_change, self.world.affordances.lane, lateral)
        if heading is not None and not is_open(heading.target, ROAD):
            lateral = KEEP
        done = plan(self.world, Action(lateral, how), EGO, SIMULATION)
        y_m, speed = float(self.world.snapshot.y_m[0]), float(self.world.snapshot.speed_m_s[0])
        for command in done.commands:
            assert abs(command.y_m - y_m) <= 0.76 * 0.5 + 1e-9
            assert abs(command.speed_m_s - speed) <= 4.0 * 0.5 + 1e-9
            assert 0 <= command.speed_m_s <= 30
            assert holds(command.y_m, 1.8, 0.0, ROAD)
            y_m, speed = command.y_m, command.speed_m_s
        self.world = after(done)

    @invariant()
    def what_is_in_progress_is_readable_from_position_and_velocity(self) -> None:
        y_m = float(self.world.snapshot.y_m[0])
        v_y = float(self.world.snapshot.lateral_speed_m_s[0])
        assert recovered(y_m, v_y) == self.world.lane_change

    @invariant()
    def the_ego_rests_on_centres_only_and_moves_only_between_them(self) -> None:
        y_m = float(self.world.snapshot.y_m[0])
        if self.world.lane_change is None:
            assert y_m in (RIGHT, CENTER, LEFT)
        else:
            assert abs(y_m / 0.76 - round(y_m / 0.76)) < 1e-6
            assert round(y_m / 0.76) % 5 != 0


TestAnyLateralActions = AnyLateralActions.TestCase
TestAnyLateralActions.settings = settings(max_examples=60, stateful_step_count=40)
