"""The outcome of the ego's way, which every episode on a road with an exit or a ramp has."""

from collections.abc import Callable
from typing import Any

import pytest
from drives import BRAKE, KEEP, LEFT, RIGHT, Place

from drl_av.config import Config
from drl_av.drivers.registry import rule_driver
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics
from drl_av.env.rollout import rollout
from drl_av.scenarios.highways import ExitDescription, MergeDescription, StraightDescription
from drl_av.scenarios.road_description import PlacedVehicle

EXIT_M, LANE_END_M = 1300.0, 750.0
"""Where the off-ramp parts from the highway, and where the acceleration lane ends."""
Placed = Callable[..., HighwayEnv]


def ego(lane: int, position_m: float, speed_m_s: float = 25.0) -> PlacedVehicle:
    return PlacedVehicle("ego", lane, position_m, speed_m_s, 30.0)


@pytest.fixture
def placed(place: Place) -> Placed:
    """Makes an environment without a check from the vehicles on a kind of road."""

    def make(kind: type[Any], *vehicles: PlacedVehicle, decisions: int = 200) -> HighwayEnv:
        config = Config().updated("simulation", decisions_per_episode=decisions)
        env = place(*vehicles, kind=kind, config=config)
        env.reset(seed=0)
        return env

    return make


def outcomes(env: HighwayEnv, *actions: int) -> list[str]:
    """The outcome after each decision of an episode; the last action is repeated to its end."""
    found, over = [], False
    while not over:
        action = actions[min(len(found), len(actions) - 1)]
        *_, terminated, truncated, info = env.step(action)
        found.append(info["way"])
        over = terminated or truncated
        fails = terminated or info["way"] in ("exit missed", "not merged")
        assert info["is_success"] is (over and not fails)
    return found


def test_an_ego_that_brakes_to_a_stop_before_its_exit_misses_it_when_the_time_is_up(
    placed: Placed,
) -> None:
    env = placed(ExitDescription, ego(1, EXIT_M - 600.0), decisions=20)
    assert outcomes(env, BRAKE) == [""] * 19 + ["exit missed"]


def test_a_collision_before_the_exit_misses_it_and_one_after_it_does_not(placed: Placed) -> None:
    stands = PlacedVehicle("stands", 0, EXIT_M - 10.0, 0.0, 0.1)
    before = outcomes(placed(ExitDescription, ego(0, EXIT_M - 90.0), stands), KEEP)
    assert (len(before), before[-1]) == (4, "exit missed")  # 75 m to its rear bumper, at 25 m/s
    env = placed(ExitDescription, ego(0, EXIT_M - 30.0))
    after = outcomes(env, KEEP, KEEP, LEFT)  # over the edge of the off-ramp
    assert env.scene.snapshot.s_m[0] < env.road.end_m
    assert after[-1] == "exit taken"


def test_an_ego_that_hits_the_gore_with_its_centre_in_the_exit_lane_misses_the_exit(
    placed: Placed,
) -> None:
    # it passes the gore after 3.2 s of a lane change of 5 s: its centre is over the line already
    env = placed(ExitDescription, ego(1, EXIT_M - 80.0))
    found = outcomes(env, RIGHT)
    assert env.scene.affordances.lane == 0
    assert found == ["", "", "", "exit missed"]


def test_an_ego_merges_where_its_lane_ends_and_not_before(placed: Placed) -> None:
    env = placed(MergeDescription, ego(0, LANE_END_M - 160.0))
    found = outcomes(env, LEFT)
    assert env.scene.affordances.lane > 0
    assert found[:7] == ["", "", "", "", "", "", "merged"]  # 160 m at 25 m/s
    assert set(found[7:]) == {"merged"}


def test_an_ego_that_keeps_its_lane_hits_its_end_and_has_not_merged(placed: Placed) -> None:
    assert outcomes(placed(MergeDescription, ego(0, LANE_END_M - 60.0)), KEEP) == [
        *("", "", "not merged")
    ]


@pytest.mark.parametrize(("kind", "lane"), [(MergeDescription, 1), (StraightDescription, 0)])
def test_an_ego_in_a_lane_that_goes_on_has_no_way(
    kind: type[Any], lane: int, placed: Placed
) -> None:
    assert set(outcomes(placed(kind, ego(lane, 600.0), decisions=3), KEEP)) == {""}


@pytest.mark.parametrize("driver", ["sumo", "sumo-tuned"])
def test_an_ego_of_sumo_that_waits_for_its_exit_to_the_end_has_missed_it(
    driver: str, placed: Placed
) -> None:
    # a queue stands in the deceleration lane and beside the ego: SUMO stops it before the gore
    queue = [
        PlacedVehicle(f"queue_{number}", 0, EXIT_M - 8.0 * number, 0.0, 0.1) for number in range(30)
    ]
    env = placed(ExitDescription, ego(1, EXIT_M - 150.0, 15.0), *queue, decisions=40)
    metrics = EpisodeMetrics()
    for decision in rollout(env, rule_driver(driver, env.config), 0):
        metrics.add(decision)
    assert decision.truncated
    assert decision.next_scene.affordances.ego_speed_m_s < 0.1
    assert decision.next_scene.affordances.mandatory.lanes == -1  # it stands before the gore
    assert not decision.failed
    row = metrics.result(driver, env.check_name, 30, 0)
    assert (row.way, row.missed, row.collided) == ("exit missed", True, False)


def test_each_episode_has_a_way_of_its_own(placed: Placed) -> None:
    env = placed(ExitDescription, ego(0, EXIT_M - 60.0))
    assert outcomes(env, KEEP)[-1] == "exit taken"
    env.reset(seed=1)
    assert env.step(KEEP)[-1]["way"] == ""
