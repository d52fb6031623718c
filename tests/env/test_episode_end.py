"""How an episode ends: after its last decision, or with a collision."""

import itertools
from typing import Any

import pytest
from drives import KEEP, LEFT, RIGHT, Place, start, until_over, y_m

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.traffic.scenario import PlacedVehicle
from drl_av.traffic.snapshot import CollisionKind


def test_an_episode_is_truncated_after_200_decisions(env: HighwayEnv) -> None:
    start(env, 0)
    for decision in range(1, 201):
        _, _, terminated, truncated, _ = env.step(KEEP)
        assert not terminated
        assert truncated is (decision == 200)


def collided(info: dict[str, Any]) -> tuple[CollisionKind, str]:
    return CollisionKind(info["collision"]), info["collided_with"]


def test_the_number_of_decisions_starts_at_0_in_each_episode() -> None:
    made = HighwayEnv(config=Config().updated("simulation", decisions_per_episode=3))
    for _ in range(2):
        start(made, 1)
        assert [made.step(KEEP)[3] for _ in range(3)] == [False, False, True]
    made.close()


def test_ego_at_30_m_s_rear_ends_one_at_5(place: Place) -> None:
    made = place(
        PlacedVehicle("ego", 1, 50.0, 30.0, 30.0), PlacedVehicle("slow", 1, 130.0, 5.0, 5.0)
    )
    made.reset(seed=0)
    info = until_over(made, KEEP)
    assert collided(info) == (CollisionKind.HIT_AHEAD, "slow")
    assert CollisionKind(info["collision"]).ego_hit
    # 75 m at 25 m/s: the third second
    assert made.decisions == 3


def test_ego_standing_is_hit_from_behind(place: Place) -> None:
    made = place(
        PlacedVehicle("ego", 1, 100.0, 0.0, 30.0), PlacedVehicle("fast", 1, 88.0, 30.0, 30.0)
    )
    made.reset(seed=0)
    info = until_over(made, KEEP)
    assert collided(info) == (CollisionKind.HIT_FROM_BEHIND, "fast")
    assert not CollisionKind(info["collision"]).ego_hit


@pytest.mark.parametrize(("lane", "action"), [(2, LEFT), (0, RIGHT)])
def test_ego_swipes_the_vehicle_alongside(place: Place, lane: int, action: int) -> None:
    made = place(
        PlacedVehicle("ego", 1, 100.0, 20.0, 30.0), PlacedVehicle("beside", lane, 102.0, 20.0, 20.0)
    )
    made.reset(seed=0)
    info = until_over(made, action)
    assert collided(info) == (CollisionKind.HIT_BESIDE, "beside")
    # 2 m between the bodies at 0.76 m/s: the third second
    assert made.decisions == 3


@pytest.mark.parametrize(("lane", "action"), [(0, RIGHT), (2, LEFT)])
def test_ego_leaves_the_road(place: Place, lane: int, action: int) -> None:
    made = place(PlacedVehicle("ego", lane, 100.0, 20.0, 30.0))
    made.reset(seed=0)
    info = until_over(made, action)
    assert collided(info) == (CollisionKind.HIT_EDGE, "")
    assert CollisionKind(info["collision"]).ego_hit
    # 1 m from its side to the edge at 0.76 m/s: the second second
    assert made.decisions == 2


def test_ego_runs_into_the_barricade(unchecked: HighwayEnv) -> None:
    made = HighwayEnv("barricaded_right_lane", safety_check="permit_all")
    start(made, 0)
    info = until_over(made, RIGHT)
    assert collided(info) == (CollisionKind.HIT_EDGE, "")
    assert y_m(made) > 2.8
    made.close()


def test_under_the_check_the_same_driver_does_none_of_this(place: Place) -> None:
    made = place(
        PlacedVehicle("ego", 1, 50.0, 20.0, 30.0),
        PlacedVehicle("slow", 1, 130.0, 5.0, 5.0),
        PlacedVehicle("beside", 2, 50.0, 20.0, 20.0),
        safety_check="paper",
    )
    made.reset(seed=0)
    rules = set()
    for action in itertools.islice(itertools.cycle([LEFT + 1, RIGHT + 1, 1]), 60):
        _, _, terminated, _, info = made.step(action)
        rules.add(info["rule"])
        assert not terminated
    assert len(rules) > 1
