"""The safety check by itself: a mask over the actions, and a wrapper around any driver."""

from functools import partial

import numpy as np
import pytest
import worlds
from hypothesis import given
from worlds import BARRICADED_ROAD, SLOW_LEADER, ahead, behind, scene, scenes

from drl_av.config import SafetyConfig
from drl_av.drivers.checked import CheckedDriver, PolicyDriver
from drl_av.drivers.rule_based import SumoDriver
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.safety import action_mask
from drl_av.safety.check import Rule, Verdict, apply_check
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


def test_no_check_is_put_around_sumo_which_proposes_nothing() -> None:
    sumo = SumoDriver(EgoModel())
    with pytest.raises(ConfigError, match=r"SUMO itself drives the ego .* wrap another driver"):
        CheckedDriver(sumo, PAPER)
    with pytest.raises(ConfigError, match=r"has no actions: .* env\.unwrapped\.hand_over"):
        sumo.act(worlds.ALONE, NOTHING)


@given(scenes())
def test_what_the_mask_permits_fires_no_rule_and_what_it_forbids_does(scene: Scene) -> None:
    for allowed, action in zip(action_mask(PAPER, scene), ACTIONS, strict=True):
        verdict = PAPER(scene, action)
        assert (allowed == 1) == (verdict == Verdict(action, Rule.NONE))


def test_a_checked_driver_carries_out_what_the_check_says_and_counts() -> None:
    traffic_commands = iter([1, 3, 9])
    driver = CheckedDriver(PolicyDriver(lambda observation: next(traffic_commands)), PAPER)
    driver.start(0)
    assert driver.act(SLOW_LEADER, NOTHING).number == 0
    assert driver.verdict == Verdict(ACTIONS[0], Rule.IN_LANE)
    assert driver.act(SLOW_LEADER, NOTHING).number == 3
    assert driver.verdict == Verdict(ACTIONS[3], Rule.NONE)
    assert driver.act(SLOW_LEADER, NOTHING).number == 0
    assert driver.verdict == Verdict(ACTIONS[0], Rule.IN_LANE | Rule.LANE_CHANGE)
    assert driver.triggers == 2
    driver.start(1)
    assert (driver.verdict, driver.triggers) == (None, 0)
