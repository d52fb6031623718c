"""The vehicle ahead for which SUMO is asked, and the speeds that are requested of the vehicles."""

import math

import numpy as np
import pytest

from drl_av.config import Config
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.simulation.speed_requests import LEFT_TO_SUMO
from drl_av.twin.asking import its_follow_speed
from drl_av.twin.step import leader, request_speeds, see_ahead
from drl_av.twin.traffic import net_of, sort_and_activate
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    COUNT,
    DESIRED_M_S,
    FRONT_M,
    LANE,
    LENGTH_M,
    MASK,
    NEXT_M_S,
    ORDER,
    REQUESTED_M_S,
    SHADOW,
    SPEED_M_S,
    WISH_M_S2,
    Net,
    World,
    empty_worlds,
)

BOTH = 0b011
"""The lanes 0 and 1."""


@pytest.fixture(scope="module")
def net() -> Net:
    """A lap of 500 m with four edges of 125 m."""
    return net_of(load_scenario(find_scenario("circular_three_lane")), Config())


def placed(net: Net, *vehicles: tuple[float, int, int]) -> World:
    """Return vehicles of 5 m by front, lane of the front, and the lanes that the body overlaps."""
    world = World(*(array[0] for array in empty_worlds(1, len(vehicles), net.lanes)))
    world.near[COUNT] = len(vehicles)
    world.x[LENGTH_M], world.z[ORDER] = 5.0, np.arange(len(vehicles))
    world.x[FRONT_M], world.z[LANE], world.z[MASK] = zip(*vehicles, strict=True)
    sort_and_activate(world, net)
    return world


def ahead(net: Net, *others: tuple[float, int, int]) -> tuple[int, float]:
    """Return the leader of a vehicle at 20 m in lane 0, and the gap without the minimum gap."""
    world = placed(net, (20.0, 0, 1), *others)
    return leader(world, net, int(np.flatnonzero(world.z[ORDER] == 0)[0]))


def test_a_vehicle_in_the_lane_hides_those_that_only_overlap_it_on_the_same_edge(net: Net) -> None:
    assert ahead(net, (60.0, 0, 1)) == (1, 32.5)  # 60 - 5 - 20 - 2.5
    assert ahead(net, (40.0, 1, BOTH), (60.0, 0, 1)) == (2, 32.5)
    assert ahead(net, (40.0, 1, BOTH), (140.0, 0, 1)) == (1, 12.5)
    assert ahead(net, (40.0, 1, 0b010), (140.0, 0, 1)) == (2, 112.5)


def test_an_overlapping_vehicle_behind_on_the_same_edge_hides_the_one_ahead(net: Net) -> None:
    assert ahead(net, (40.0, 1, BOTH), (140.0, 0, 1), (10.0, 1, BOTH)) == (2, 112.5)
    assert ahead(net, (40.0, 1, BOTH), (140.0, 0, 1), (490.0, 1, BOTH)) == (1, 12.5)


def test_a_long_vehicle_counts_on_the_edge_of_its_rear_behind_a_short_one(net: Net) -> None:
    world = placed(net, (20.0, 0, 1), (131.0, 1, BOTH), (140.0, 0, 1))
    world.x[LENGTH_M, 2], world.x[DESIRED_M_S], world.x[SPEED_M_S, 0] = 16.0, 30.0, 20.0
    world.x[ACCELERATION_M_S2], world.z[SHADOW] = 1.5, -1
    assert leader(world, net, 2) == (2, 101.5)  # its rear is at 124 m
    see_ahead(world, net, 2)
    assert world.x[NEXT_M_S, 0] == its_follow_speed(world, 0, 101.5, 0.0)


def test_sumo_looks_at_whole_edges_up_to_200_m(net: Net) -> None:
    # from 20 m the second edge begins after 105 m, the third after 230 m
    assert ahead(net, (249.0, 0, 1)) == (1, 221.5)
    assert ahead(net, (256.0, 0, 1)) == (-1, -1.0)
    assert ahead(net, (253.0, 0, 1)) == (1, 225.5)  # its rear is still on the second edge


def test_vehicles_of_sumo_are_limited_and_ours_get_their_wish(net: Net) -> None:
    world = placed(net, (100.0, 0, 1), (80.0, 0, 1), (300.0, 1, 2), (280.0, 1, 2))
    world.x[SPEED_M_S], world.x[ACCELERATION_M_S2] = [20.0, 20.0, 30.0, 20.0], 1.5
    world.x[WISH_M_S2] = [math.nan, math.nan, -2.0, math.nan]
    request_speeds(world, net)
    # gap 12.5 m, u = 20: 12.5 + 400 / 8 - 5 = v^2 / 8 + v / 4
    assert world.x[REQUESTED_M_S, 1] == pytest.approx(math.sqrt(1 + 8 * 57.5) - 1)
    assert world.x[REQUESTED_M_S, 2] == LEFT_TO_SUMO  # SUMO's models brake
    assert world.x[REQUESTED_M_S, 3] == LEFT_TO_SUMO  # the one ahead is so fast
