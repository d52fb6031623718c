"""The falsifier's families on roads whose lanes begin and end.

The acceleration lane begins at 500 m and ends at 650 m. The deceleration lane begins at 1,050 m,
and parts from the highway at 1,300 m. Bodies are 5 m long and 1.8 m wide.
"""

from typing import Any

import numpy as np
import pytest

from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.road.road import Road, holds
from drl_av.road.snapshot import Collision, CollisionKind
from drl_av.safety import named_check
from drl_av.safety.check import SafetyCheck
from drl_av.safety.strict import Strict
from verification.adversary import ROAD, Mover, Orders, World, one_by_one
from verification.falsification import genes, orders, play
from verification.falsify import in_sumo
from verification.families import PLACED, placed
from verification.open_families import EXIT_ROAD, MERGE_ROAD, OFF_RAMP, OPEN_FAMILIES, RAMP

STRICT = Config().updated("safety", check="strict")
NO_CHECK = Config().updated("safety", check="permit_all")
EDGE = Collision(CollisionKind.HIT_EDGE, None)


def drawn(name: str, scenes: int, config: Config = STRICT) -> World:
    family = OPEN_FAMILIES[name]
    numbers = np.random.default_rng(3).random((scenes, PLACED * family.others))
    return family.start(numbers, config)


def driven(name: str, scenes: int, config: Config, other: SafetyCheck | None = None) -> World:
    """Scenes of a random adversary, at their end; ``other`` replaces the check of the config."""
    family, world = OPEN_FAMILIES[name], drawn(name, scenes, config)
    check = one_by_one(other or named_check(config, road=world.road))
    genome = np.random.default_rng(4).normal(size=(scenes, genes(family)))
    commands = orders(genome, family, config)
    play(world, commands, check, Mover(config))
    return world


@pytest.mark.parametrize("name", OPEN_FAMILIES)
def test_each_start_is_on_its_lanes_and_keeps_the_invariant(name: str) -> None:
    world = drawn(name, 300)
    strict = named_check(STRICT, road=world.road)
    assert isinstance(strict, Strict)
    for row in range(300):
        scene = world.scene(row)
        assert strict.fallback_is_free(scene)
        assert holds(world.y_m[row, 0], 1.8, world.x_m[row, 0] + 2.5, world.road)


def test_the_ego_has_to_do_with_the_end_of_a_lane_in_each_family() -> None:
    ends_m = {"lane-end": RAMP.end_m, "merging": RAMP.end_m, "exit": OFF_RAMP.joined_to_m}
    for name, end_m in ends_m.items():
        world = driven(name, 300, STRICT)
        lane = np.round(world.y_m / 3.8)
        passed = world.x_m[:, 0] > end_m
        changed = lane[:, 0] != np.round(drawn(name, 300).y_m[:, 0] / 3.8)
        # many pass the place, many change lanes before or after it, and others come over
        assert passed.sum() > 60
        assert changed.sum() > 60
        assert (lane != np.round(drawn(name, 300).y_m / 3.8))[:, 1:].any(axis=1).sum() > 60
        assert not world.collisions


class Blind(Strict):
    """The check without the ends of lanes."""

    def _arguments(self, scene: Scene) -> tuple[Any, ...]:
        indicators = scene.indicators
        ground = (*indicators.ground[:2], np.empty((0, 3)))
        blind = Scene(scene.snapshot, indicators._replace(ground=ground), scene.lane_change, ROAD)
        return super()._arguments(blind)


@pytest.mark.parametrize("name", OPEN_FAMILIES)
def test_a_strict_that_does_not_know_of_ends_of_lanes_drives_over_them(name: str) -> None:
    blind = Blind(STRICT.strict, STRICT.ego, STRICT.simulation)
    world = driven(name, 300, STRICT, blind)
    assert len(world.collisions) >= 5
    assert set(world.collisions.values()) == {EDGE}
    assert (world.least_m[list(world.collisions), -len(world.road.barriers) :] < 0).any()


@pytest.mark.parametrize("config", [STRICT, NO_CHECK], ids=["strict", "permit_all"])
@pytest.mark.parametrize("name", OPEN_FAMILIES)
def test_scenes_end_in_sumo_as_in_the_simulator(name: str, config: Config) -> None:
    (row,) = in_sumo(config, [name], scenes=8, seed=5)
    assert row["unlike_the_equations"] == row["furthest_from_the_equations_m"] == 0
    assert (row["ego_hit"] > 0) is (config is NO_CHECK)


@pytest.mark.parametrize(
    ("road", "front_m", "y_m", "moves_right", "collides", "separation_m"),
    [
        # 20 m/s are 10 m in a step of half a second: 0.1 m short of the end of the lane
        (MERGE_ROAD, 639.9, 0.0, False, False, 0.1),
        (MERGE_ROAD, 640.1, 0.0, False, True, -0.1),
        # in the next lane its side is at 2.9 m, and the end of lane 0 reaches to 1.9 m
        (MERGE_ROAD, 640.1, 3.8, False, False, 1.0),
        # a step of 0.38 m to the right brings its side to 2.52 m, another two to 1.76 m
        (MERGE_ROAD, 640.1, 3.8, True, False, 0.62),
        (MERGE_ROAD, 640.1, 3.04, True, True, -0.1),
        (MERGE_ROAD, 600.0, 3.04, True, False, 40.0),
        # the ramp is not joined to the highway up to 500 m
        (MERGE_ROAD, 480.0, 3.04, True, True, 160.0),
        # over the line at which the off-ramp parts by 0.14 m; its centre is beyond this in lane 0
        (EXIT_ROAD, 1289.0, 3.04, True, False, 1.0),
        (EXIT_ROAD, 1291.0, 3.04, True, True, -0.14),
        (EXIT_ROAD, 1291.0, 0.0, False, False, 1.0),
    ],
)
def test_the_ego_collides_with_the_end_of_a_lane_that_its_body_is_over(
    road: Road, front_m: float, y_m: float, moves_right: bool, collides: bool, separation_m: float
) -> None:
    one = np.ones(1, np.int64)
    far_behind = np.array([[-200.0]]), np.ones((1, 1)), np.zeros((1, 1))
    world = placed(one, 20.0 * one, *far_behind, front_m - 2.5, road)
    world.y_m[0, 0] = y_m
    if moves_right:
        world.origin, world.target = one, 0 * one
    action = np.array([Action(Lateral.KEEP, Longitudinal.MAINTAIN).number])
    next(Mover(STRICT).steps(world, action, Orders(action, np.zeros((1, 1)), np.zeros((1, 1)))))
    assert world.collisions == ({0: EDGE} if collides else {})
    assert world.least_m[0, 1] == pytest.approx(separation_m)
