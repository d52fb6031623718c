"""The safety check by itself, a mask over the actions; and a driver that drives steadily."""

from functools import partial

import numpy as np
import pytest
import worlds
from hypothesis import given
from worlds import BARRICADED_ROAD, SLOW_LEADER, ahead, behind, scene, scenes

from drl_av.config import Config, SafetyConfig
from drl_av.drivers.checked import PolicyDriver, SteadyDriver
from drl_av.drivers.registry import find_drivers, make_drivers
from drl_av.drivers.rule_based import SumoDriver
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.scene import LaneChange, Scene
from drl_av.errors import ConfigError
from drl_av.safety import action_mask
from drl_av.safety.check import Rule, SafetyCheck, Verdict, apply_check
from drl_av.safety.paper import paper
from drl_av.simulation.vehicle_calls import EgoModel

PAPER = partial(paper, config=SafetyConfig())
NOTHING = np.zeros(27, np.float32)


def test_behind_a_slow_leader_only_speeding_up_and_changing_lanes_are_masked() -> None:
    # T_C is 4 s: "maintain" is what eq. 4 asks, braking is as safe; rule 3 forbids both sides
    assert action_mask(PAPER, SLOW_LEADER).tolist() == [1, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0]


def test_at_two_seconds_only_the_hard_brake_is_left() -> None:
    near = scene(ahead(10.0, speed_m_s=15.0), behind(9.0))
    assert action_mask(PAPER, near).tolist() == [0, 0, 0, 1] + 8 * [0]


def test_a_barricaded_lane_masks_its_side_alone() -> None:
    free = scene(road=BARRICADED_ROAD)
    assert action_mask(PAPER, free).tolist() == [1, 1, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1]


def test_a_check_that_couples_both_axes_is_masked_action_by_action() -> None:
    """Decoy: a mask made of 4 longitudinal and 3 lateral answers would permit 3 * 3 here."""

    def no_hard_swerve(scene: Scene, proposed: Action) -> Verdict:
        if proposed.lateral != Lateral.KEEP and proposed.longitudinal == Longitudinal.HARD_BRAKE:
            return Verdict(proposed._replace(lateral=Lateral.KEEP), Rule.LANE_CHANGE)
        return Verdict(proposed, Rule.NONE)

    mask = action_mask(no_hard_swerve, worlds.ALONE)
    assert [ACTIONS[row].number for row in np.flatnonzero(mask == 0)] == [7, 11]


@pytest.mark.parametrize(
    ("verdict", "message"),
    [
        (Verdict(Action(Lateral.KEEP, 7), Rule.IN_LANE), "must return a Verdict"),
        (Verdict(("left", "brake"), Rule.IN_LANE), "must return a Verdict"),
        (Verdict((0, 0), Rule.NONE), "must return a Verdict"),
        (Verdict(np.zeros(2), Rule.NONE), "must return a Verdict"),
        (Verdict(ACTIONS[2], Rule.NONE), "but named no rule"),
    ],
)
def test_a_verdict_that_contradicts_itself_is_refused(verdict: Verdict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        apply_check(lambda scene, proposed: verdict, worlds.ALONE, ACTIONS[0])


@pytest.mark.parametrize("kind", [int, float])
def test_an_action_of_plain_numbers_is_one_of_the_12(kind: type) -> None:
    plain = Verdict(Action(kind(2), kind(3)), Rule.IN_LANE)
    executed = apply_check(lambda scene, proposed: plain, worlds.ALONE, ACTIONS[0]).action
    assert executed.lateral.sign == 1
    assert executed.number == 11


def test_sumo_proposes_nothing() -> None:
    with pytest.raises(ConfigError, match=r"has no actions: .* env\.unwrapped\.hand_over"):
        SumoDriver(EgoModel()).act(worlds.ALONE, NOTHING)


@given(scenes())
def test_what_the_mask_permits_fires_no_rule_and_what_it_forbids_does(scene: Scene) -> None:
    for allowed, action in zip(action_mask(PAPER, scene), ACTIONS, strict=True):
        verdict = PAPER(scene, action)
        assert (allowed == 1) == (verdict == Verdict(action, Rule.NONE))


HOLDING = Config().updated("driver", hold_s=10.0)


def at_least(*gaps_m: float) -> SafetyCheck:
    """A check that permits to keep the speed from a gap on, and to accelerate from another on."""

    def check(scene: Scene, proposed: Action) -> Verdict:
        front = scene.affordances.front(0)
        if proposed.number in (0, 1) and front and front.gap_m < gaps_m[proposed.number]:
            return Verdict(ACTIONS[3], Rule.IN_LANE)
        return Verdict(proposed, Rule.NONE)

    return check


def steady(proposed: int, seen: Scene, check: SafetyCheck, config: Config = HOLDING) -> int:
    """The number of the action that a steady driver makes of a proposal."""
    return SteadyDriver(PolicyDriver(lambda _: proposed), check, config).act(seen, NOTHING).number


def test_a_steady_driver_accelerates_only_to_a_speed_that_it_can_hold() -> None:
    # 22 + 2 = 24 m/s behind 21 m/s: 30 m nearer in 10 s, where 40 m are needed
    check = at_least(40.0, 0.0)
    seen = {gap_m: scene(ahead(gap_m, speed_m_s=21.0), speed_m_s=22.0) for gap_m in (69.9, 70.1)}
    assert [steady(1, each, check) for each in seen.values()] == [0, 1]
    # for 5 s 55 m are enough
    shorter = HOLDING.updated("driver", hold_s=5.0)
    assert steady(1, seen[69.9], check, shorter) == 1
    assert steady(1, scene(ahead(54.9, speed_m_s=21.0), speed_m_s=22.0), check, shorter) == 0
    # at the end of the range of speeds it gains 0.5 m/s only: 5 m nearer, and 45 m are enough
    near = {gap_m: scene(ahead(gap_m, speed_m_s=29.5), speed_m_s=29.5) for gap_m in (44.9, 45.1)}
    assert [steady(1, each, check) for each in near.values()] == [0, 1]
    # it would have driven through the vehicle ahead, behind which nothing is in the way
    assert steady(1, scene(ahead(29.9, speed_m_s=21.0), speed_m_s=22.0), at_least(0.0, 0.0)) == 0


def test_a_steady_driver_leaves_all_else_as_it_is() -> None:
    check, gap_m = at_least(40.0, 0.0), 50.0
    behind_it = partial(scene, ahead(gap_m, speed_m_s=21.0), speed_m_s=22.0)
    assert steady(1, behind_it(), check) == 0
    # decoys: braking, a free lane, a vehicle beside, one behind, one that is as fast
    for proposed in (0, 2, 3, 4, 6, 8):
        assert steady(proposed, behind_it(), check) == proposed
    for other in (
        (),
        (ahead(gap_m, worlds.LEFT, speed_m_s=21.0),),
        (behind(gap_m, speed_m_s=21.0),),
        (ahead(gap_m, speed_m_s=24.0),),
    ):
        assert steady(1, scene(*other, speed_m_s=22.0), check) == 1
    # a lane change stays one
    assert [steady(5, behind_it(), check), steady(9, behind_it(), check)] == [4, 8]
    # where the check does not let it keep its speed now, it does not propose that either
    assert steady(1, behind_it(), at_least(60.0, 0.0)) == 1
    # the end of its lane is no vehicle
    ending = scene(road=worlds.MERGE, s_m=740.0, y_m=worlds.RIGHT, speed_m_s=22.0)
    assert ending.affordances.front(0) is not None
    assert steady(1, ending, check) == 1


def test_a_steady_driver_begins_only_a_lane_change_that_it_can_go_on_with() -> None:
    def check(scene: Scene, proposed: Action) -> Verdict:
        change = scene.lane_change
        rear = scene.affordances.rear(change.sign) if change else None
        if rear and rear.gap_m < 25.0 and proposed.lateral is Lateral.KEEP:
            return Verdict(ACTIONS[4], Rule.LANE_CHANGE)
        return Verdict(proposed, Rule.NONE)

    def begun(proposed: int, gap_m: float) -> int:
        return steady(proposed, scene(behind(gap_m, worlds.LEFT, speed_m_s=25.0)), check)

    # at 20 m/s the one behind comes 5 m nearer in a second, while the ego goes 20 m
    assert [begun(8, 30.1), begun(8, 29.9)] == [8, 0]
    # accelerating it goes 21.5 m, braking 18.5 m
    assert [begun(9, 28.6), begun(9, 28.4)] == [9, 1]
    assert [begun(10, 31.6), begun(10, 31.4)] == [10, 2]
    # decoys: the other side, a lane change that has begun, nothing else to propose
    assert begun(4, 29.9) == 4
    late = scene(
        behind(29.0, worlds.LEFT, speed_m_s=25.0),
        y_m=worlds.CENTER + 0.76,
        v_y=0.76,
        lane_change=LaneChange(1, 2),
    )
    assert steady(8, late, check) == 8

    def no_keeping(scene: Scene, proposed: Action) -> Verdict:
        if scene.lane_change is None and proposed.lateral is Lateral.KEEP:
            return Verdict(ACTIONS[8], Rule.IN_LANE)
        return check(scene, proposed)

    assert steady(8, scene(behind(29.9, worlds.LEFT, speed_m_s=25.0)), no_keeping) == 8


def test_who_comes_from_the_next_lane_but_one_is_foreseen() -> None:
    """The other is 0.3 m from the lane that the ego enters, and moves 0.76 m in a second."""

    def check(scene: Scene, proposed: Action) -> Verdict:
        if scene.lane_change and proposed.lateral is Lateral.KEEP and scene.affordances.front(1):
            return Verdict(ACTIONS[4], Rule.LANE_CHANGE)
        return Verdict(proposed, Rule.NONE)

    edge_m = worlds.LEFT + 1.9 + 0.9 + 0.3
    road = worlds.ROAD.__class__(500.0, worlds.LANE_M, (True,) * 4)
    coming, staying = (ahead(20.0, edge_m, v_y=v_y) for v_y in (-0.76, 0.0))
    assert steady(8, scene(coming, road=road), check) == 0
    assert steady(8, scene(staying, road=road), check) == 8


def test_on_a_loop_the_vehicle_ahead_may_be_beyond_its_first_metre() -> None:
    seen = scene(ahead(69.9, speed_m_s=21.0), s_m=worlds.ROAD.lap_m - 50.0, speed_m_s=22.0)
    check = at_least(40.0, 0.0)
    assert steady(1, seen, check) == 0
    beyond = scene(ahead(70.1, speed_m_s=21.0), s_m=worlds.ROAD.lap_m - 50.0, speed_m_s=22.0)
    assert steady(1, beyond, check) == 1


def test_the_setting_makes_every_driver_steady_but_sumo_s_own() -> None:
    specs = find_drivers(["idm", "pretrained-paper", "sumo-tuned"])
    made = make_drivers(specs, HOLDING)
    assert [type(driver).__name__ for driver in made.values()] == [
        *("SteadyDriver", "SteadyDriver", "SumoDriver")
    ]
    usual = make_drivers(specs, Config())
    assert not any(isinstance(driver, SteadyDriver) for driver in usual.values())
