"""Exits: the ego leaves by the off-ramp or misses it, and SUMO drives it on in both cases."""

from collections.abc import Callable
from contextlib import closing

import pytest
from drives import KEEP, LEFT, RIGHT, Place, until_over

from drl_av.config import Config
from drl_av.drivers.registry import rule_driver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.road.snapshot import CollisionKind
from drl_av.scenarios.highways import ExitDescription, OffRamp, RampToRampDescription
from drl_av.scenarios.road_description import PlacedVehicle

GORES_M = {ExitDescription: 1300.0, RampToRampDescription: 1750.0}
"""Position at which the off-ramp parts from the highway, by the description of the road."""
Placed = Callable[[type[OffRamp], int, float], HighwayEnv]


@pytest.fixture
def placed(place: Place) -> Placed:
    """Makes an environment with the ego alone in a lane, so many metres before the gore."""

    def make(kind: type[OffRamp], lane: int, before_m: float) -> HighwayEnv:
        ego = PlacedVehicle("ego", lane, GORES_M[kind] - before_m, 25.0, 30.0)
        env = place(ego, kind=kind)
        env.reset(seed=0)
        return env

    return make


@pytest.mark.parametrize("kind", GORES_M)
@pytest.mark.parametrize("lane", [0, 1, 3])
def test_ego_drives_on_at_constant_speed_whether_it_takes_the_exit_or_not(
    kind: type[OffRamp], lane: int, placed: Placed
) -> None:
    env = placed(kind, lane, 33.0)
    begin_m, truncated = float(env.scene.snapshot.s_m[0]), False
    while not truncated:
        *_, terminated, truncated, info = env.step(KEEP)
        snapshot = env.scene.snapshot
        assert not terminated
        assert not info["collision"]
        assert snapshot.s_m[0] == pytest.approx(begin_m + 25.0 * env.decisions)
        assert (snapshot.speed_m_s[0], env.scene.affordances.lane) == (25.0, lane)
        outcome = "exit taken" if lane == 0 else "exit missed"
        assert info["way"] == ("" if env.decisions == 1 else outcome)  # its front passes in 1.32 s
    # 33 m and 100 m more for its centre, which is 2.5 m behind its front, at 25 m/s
    assert env.decisions == 6


@pytest.mark.parametrize(("lane", "action"), [(1, RIGHT), (0, LEFT)])
def test_ego_that_crosses_the_gore_hits_the_edge(lane: int, action: int, placed: Placed) -> None:
    # its body is over the line after 2 s, and off it after 4 s; it passes the gore after 3 s
    env = placed(ExitDescription, lane, 70.0)
    assert until_over(env, action)["collision"] == CollisionKind.HIT_EDGE.value
    assert env.decisions == 3


def test_ego_that_has_changed_lanes_before_the_gore_takes_the_exit(placed: Placed) -> None:
    env = placed(ExitDescription, 1, 130.0)
    for _ in range(7):
        *_, info = env.step(RIGHT if env.decisions == 0 else KEEP)
        assert not info["collision"]
    assert env.scene.snapshot.s_m[0] > 1310.0
    assert info["way"] == "exit taken"


def test_another_vehicle_placed_in_the_deceleration_lane_takes_the_off_ramp(place: Place) -> None:
    there = 1280.0, 20.0, 20.0
    others = PlacedVehicle("in", 0, *there), PlacedVehicle("by", 1, *there)
    ego = PlacedVehicle("ego", 3, 1200.0, 20.0, 30.0)
    env = place(ego, *others, kind=ExitDescription, safety_check="paper")
    env.reset(seed=0)
    for _ in range(4):
        env.step(KEEP)
    shot = env.scene.snapshot
    found = dict(zip(shot.ids, shot.y_m.round(1), strict=True))
    assert found == {"ego": 11.4, "in": 0.0, "by": 3.8}
    assert shot.s_m[1:] == pytest.approx(1357.5, abs=1.0)


@pytest.mark.parametrize("scenario", ["exit", "ramp_to_ramp"])
def test_sumo_drives_the_ego_to_its_exit_and_all_others_pass_it(scenario: str) -> None:
    config = Config().updated("simulation", scenario=scenario)
    with closing(HighwayEnv(config=config)) as env:
        for decision in rollout(env, rule_driver("sumo", config), 1, 40):
            shot = decision.next_scene.snapshot
            assert shot.y_m[1:].min() > 1.9 + 0.9  # in the through lanes as a whole
    assert decision.truncated
    assert shot.s_m[0] >= env.road.end_m
    assert decision.route_outcome == "exit taken"
