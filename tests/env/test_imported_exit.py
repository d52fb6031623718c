"""Episodes on a user's motorway, which the ego leaves by a lane that begins on the way."""

from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
from drives import KEEP, RIGHT, until_over
from nets import TWO_LANES, TWO_LANES_WAYS, along, leaving

from drl_av.config import Config
from drl_av.drivers.registry import load_driver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.road.snapshot import CollisionKind
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.road_description import PlacedVehicle

BEGINS_M, EXIT_M = 1004.0, 1280.65
"""Where the exit's lane begins and where it parts (``tests/scenarios/test_imported_exit.py``)."""
LINE_M = 3.5 / 2
"""The left border of the exit's lane."""
Made = Callable[..., HighwayEnv]


@pytest.fixture(scope="module")
def net(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return leaving(tmp_path_factory.mktemp("leaving"))


@pytest.fixture
def made(net: Path, tmp_path: Path, stack: ExitStack) -> Made:
    """Makes an environment of a route from the beginning to an edge, and of its vehicles."""

    def make(to_edge: str, check: str, *vehicles: PlacedVehicle, own: Path = net) -> HighwayEnv:
        description = along(own, 0, to_edge=to_edge, flow_per_h=700.0, vehicles=vehicles)
        write_scenario(tmp_path / "road", description)
        config = Config().updated("simulation", scenario=str(tmp_path / "road"))
        config = config.updated("safety", check=check)
        return stack.enter_context(closing(HighwayEnv(config=config, action_mask=True)))

    return make


def test_a_driver_waits_for_the_lane_to_come_and_takes_the_exit_under_strict(made: Made) -> None:
    env = made("away", "strict")
    for seed in (2, 4):
        for decision in rollout(env, load_driver("gap-mobil", env.config), seed):
            shot = decision.next_scene.snapshot
            assert decision.collision is None
            if shot.s_m[0] + 2.5 < BEGINS_M:
                assert shot.y_m[0] - 0.9 >= LINE_M
        assert decision.truncated
        assert decision.route_outcome == "exit taken"
        assert shot.s_m[0] >= EXIT_M + 100.0
        assert shot.y_m[0] == pytest.approx(0.0)
        # all others stay on the motorway
        assert shot.y_m[1:][shot.s_m[1:] > EXIT_M].min() - 0.9 > LINE_M


def test_a_route_straight_on_is_driven_past_the_lane_of_the_exit(made: Made) -> None:
    env = made("e2", "strict")
    for decision in rollout(env, load_driver("gap-mobil", env.config), 0):
        assert decision.collision is None
        assert decision.route_outcome == ""
    assert decision.truncated
    assert decision.next_scene.snapshot.s_m[0] >= env.road.end_m > 1800.0
    assert decision.next_scene.affordances.lane > 0


def test_the_lane_to_come_is_entered_where_it_begins_and_never_before(made: Made) -> None:
    # its centre is 66.5 m before it, at 25 m/s: beside it after 2.66 s
    ego = PlacedVehicle("ego", 1, BEGINS_M - 66.5, 25.0, 30.0)
    env = made("away", "strict", ego)
    _, info = env.reset(seed=0)
    rows, allowed = [], [int(info["action_mask"][RIGHT])]
    for _ in range(9):
        *_, info = env.step(RIGHT)
        allowed.append(int(info["action_mask"][RIGHT]))
        rows.append((info["executed_action"], round(float(env.scene.snapshot.y_m[0]), 2)))
    assert allowed[:4] == [0, 0, 0, 1]
    assert rows[:4] == [(KEEP, 3.5), (KEEP, 3.5), (KEEP, 3.5), (RIGHT, 2.8)]
    assert rows[7][1] == 0.0
    assert until_way(env) == "exit taken"


def until_way(env: HighwayEnv) -> str:
    """The outcome of an ego that keeps its lane to the end of the episode."""
    truncated = False
    while not truncated:
        *_, terminated, truncated, info = env.step(KEEP)
        assert not terminated
    return str(info["way"])


def test_an_ego_that_enters_the_lane_before_it_begins_hits_the_edge(made: Made) -> None:
    ego = PlacedVehicle("ego", 1, BEGINS_M - 152.5, 25.0, 30.0)
    env = made("away", "permit_all", ego)
    env.reset(seed=0)
    assert until_over(env, RIGHT)["collision"] == CollisionKind.HIT_EDGE.value
    assert env.decisions == 2  # after 1.2 s its body is over the line


@pytest.mark.parametrize(
    ("lanes_of_exit", "lane", "way"),
    [
        *((1, 0, "exit taken"), (1, 1, "exit missed")),
        *((2, 0, "exit taken"), (2, 1, "exit taken"), (2, 2, "exit missed")),
    ],
)
def test_the_ego_drives_on_at_constant_speed_whether_it_takes_a_lane_of_the_exit_or_misses_it(
    lanes_of_exit: int, lane: int, way: str, made: Made, net: Path, tmp_path: Path
) -> None:
    if lanes_of_exit == 2:
        net = leaving(tmp_path, ways=TWO_LANES_WAYS, lanes=TWO_LANES)
    ego = PlacedVehicle("ego", lane, EXIT_M - 33.0, 25.0, 30.0)
    env = made("away", "permit_all", ego, own=net)
    env.reset(seed=0)
    begin_m = float(env.scene.snapshot.s_m[0])
    assert until_way(env) == way
    # its front is at the exit after 33 m, and its centre 100 m after the exit after 135.5 m
    assert env.decisions == 6
    assert env.scene.snapshot.s_m[0] == pytest.approx(begin_m + 25.0 * 6)
    assert env.scene.affordances.lane == lane
