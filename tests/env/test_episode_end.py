"""How an episode ends: after its last decision, or with a collision."""

import itertools

import pytest
from drives import KEEP, LEFT, RIGHT, Place, start, until_over

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.road.snapshot import CollisionKind
from drl_av.scenarios.folder import PlacedVehicle


def test_the_number_of_decisions_starts_at_0_in_each_episode() -> None:
    with HighwayEnv(config=Config().updated("simulation", decisions_per_episode=3)) as made:
        for _ in range(2):
            start(made, 1)
            assert [made.step(KEEP)[3] for _ in range(3)] == [False, False, True]


def driven(position_m: float, speed_m_s: float, lane: int = 1) -> PlacedVehicle:
    """The ego."""
    return PlacedVehicle("ego", lane, position_m, speed_m_s, 30.0)


def beside(lane: int) -> PlacedVehicle:
    return PlacedVehicle("other", lane, 102.0, 20.0, 20.0)


@pytest.mark.parametrize(
    ("ego", "other", "action", "kind", "decisions"),
    [
        # 75 m at 25 m/s: the third second
        (
            driven(50.0, 30.0),
            PlacedVehicle("other", 1, 130.0, 5.0, 5.0),
            *(KEEP, CollisionKind.HIT_AHEAD, 3),
        ),
        (
            driven(100.0, 0.0),
            PlacedVehicle("other", 1, 88.0, 30.0, 30.0),
            *(KEEP, CollisionKind.HIT_FROM_BEHIND, 1),
        ),
        # 2 m between the bodies at 0.76 m/s: the third second
        (driven(100.0, 20.0), beside(2), LEFT, CollisionKind.HIT_BESIDE, 3),
        (driven(100.0, 20.0), beside(0), RIGHT, CollisionKind.HIT_BESIDE, 3),
        # 1 m from its side to the edge at 0.76 m/s: the second second
        (driven(100.0, 20.0, 0), None, RIGHT, CollisionKind.HIT_EDGE, 2),
        (driven(100.0, 20.0, 2), None, LEFT, CollisionKind.HIT_EDGE, 2),
    ],
)
def test_a_collision_ends_the_episode_with_its_kind(
    place: Place,
    ego: PlacedVehicle,
    other: PlacedVehicle | None,
    action: int,
    kind: CollisionKind,
    decisions: int,
) -> None:
    made = place(*filter(None, (ego, other)))
    made.reset(seed=0)
    info = until_over(made, action)
    assert (info["collision"], info["collided_with"]) == (kind.value, "other" if other else "")
    assert made.decisions == decisions
    assert info["is_success"] is False


def test_a_collision_in_the_last_decision_is_no_success(place: Place) -> None:
    made = place(driven(100.0, 20.0, 0))
    made.reset(seed=0)
    made._most_decisions = 2  # it leaves the road in the second
    info = until_over(made, RIGHT)
    assert (made.decisions, info["is_success"]) == (2, False)


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
