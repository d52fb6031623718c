"""The road seen in a mirror: left is right, and nothing else changes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import ROAD, scenes

from drl_av.config import EgoConfig, ObservationConfig, SafetyConfig, SimulationConfig
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.affordances import INDICATORS, compute_indicators
from drl_av.driving.maneuver import plan
from drl_av.driving.mirror import MIRROR, mirror_of, mirrored_observations
from drl_av.driving.observation_scale import ObservationScale
from drl_av.driving.scene import LaneChange, Scene
from drl_av.driving.wide_observation import WIDE_NAMES, observe_wide
from drl_av.road.road import Road
from drl_av.safety.paper import paper

WIDTH_M = 7.6
"""From the centre of the rightmost lane to that of the leftmost."""


def mirrored(world: Scene) -> Scene:
    """The same scene on a road whose right is its left; worked out from the snapshot."""
    shot = world.snapshot
    swapped = shot._replace(
        y_m=WIDTH_M - shot.y_m,
        lateral_speed_m_s=-shot.lateral_speed_m_s,
        sumo_lane_change=-(shot.sumo_lane_change or 0),
    )
    running = world.lane_change
    if running is not None:
        running = LaneChange(2 - running.origin, 2 - running.target)
    road = Road(ROAD.lap_m, ROAD.lane_width_m, world.road.open_lanes[::-1])
    return Scene(swapped, compute_indicators(swapped, road, 250.0), running, road)


def in_the_mirror(vector: np.ndarray) -> np.ndarray:
    return vector[MIRROR.observation_permutation] * MIRROR.observation_sign


def mirrored_action(action: Action) -> Action:
    return ACTIONS[MIRROR.action_permutation[action.number]]


def test_right_and_left_actions_change_places_and_accelerations_stay() -> None:
    assert MIRROR.action_permutation.tolist() == [0, 1, 2, 3, 8, 9, 10, 11, 4, 5, 6, 7]
    for action in ACTIONS:
        assert mirrored_action(action).longitudinal is action.longitudinal
        assert mirrored_action(action).lateral.sign == -action.lateral.sign


def test_indicators_change_places_by_name_and_lateral_ones_their_sign() -> None:
    swap = {"right": "left", "left": "right"}
    for place, name in enumerate(INDICATORS):
        side, _, rest = name.partition("_")
        source = f"{swap.get(side, side)}_{rest}"
        assert INDICATORS[MIRROR.observation_permutation[place]] == source
        assert MIRROR.observation_sign[place] == (-1 if name.endswith("_y") else 1)


@given(scenes())
def test_a_mirrored_snapshot_gives_the_mirrored_observation(world: Scene) -> None:
    scale = ObservationScale(ObservationConfig(), 30.0, ROAD)
    here, there = (scale(each.indicators.values[:27]) for each in (world, mirrored(world)))
    assert in_the_mirror(here) == pytest.approx(there, abs=1e-5)


@given(scenes())
def test_the_wide_observation_has_a_mirror_image_too(world: Scene) -> None:
    here, there = (
        observe_wide(each.snapshot, each.road, 250.0, 30.0, each.lanes)
        for each in (world, mirrored(world))
    )
    mirror = mirror_of(WIDE_NAMES)
    assert mirrored_observations(here, mirror) == pytest.approx(there, abs=1e-5)


@given(scenes(), st.sampled_from(ACTIONS))
def test_the_safety_check_judges_alike_in_the_mirror(world: Scene, proposed: Action) -> None:
    action, rule = paper(world, proposed, SafetyConfig())
    verdict = paper(mirrored(world), mirrored_action(proposed), SafetyConfig())
    assert verdict == (mirrored_action(action), rule)


@given(scenes(), st.sampled_from(ACTIONS))
def test_a_plan_moves_alike_in_the_mirror(world: Scene, action: Action) -> None:
    here = plan(world, action, EgoConfig(), SimulationConfig())
    there = plan(mirrored(world), mirrored_action(action), EgoConfig(), SimulationConfig())
    for command, other in zip(here.commands, there.commands, strict=True):
        assert other.y_m == pytest.approx(WIDTH_M - command.y_m, abs=1e-9)
        assert other.lateral_speed_m_s == pytest.approx(-command.lateral_speed_m_s)
        assert other.speed_m_s == command.speed_m_s
    assert (here.lane_change is None) is (there.lane_change is None)
