"""What is asked of the vehicles at a decision: by our own drivers, and by random events."""

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.compiled import borrowing
from drl_av.drivers.background.traffic import Scratch, TrafficNumbers, decide
from drl_av.road.road import CENTERED_M
from drl_av.twin.worlds import (
    ASIDE_M,
    BRAKING,
    COUNT,
    DESIRED_M_S,
    DRIVER_COUNT,
    DRIVER_STATE,
    DRIVERS,
    EDGE,
    FIRST_LANE,
    LANE,
    MODEL,
    REQUEST_END,
    REQUEST_LANE,
    SIDE,
    STEP,
    WISH_M_S2,
    Net,
    World,
)

REQUEST_STEPS = 10
"""Steps for which SUMO tries to execute a random lane change."""


@borrowing
def drive_traffic(
    world: World, net: Net, scene: FloatArray, traffic: TrafficNumbers, scratch: Scratch, steps: int
) -> None:
    """Let our own drivers decide on a scene, shape (6, vehicles), for ``steps`` steps."""
    n, drivers = world.near[COUNT], world.z[DRIVERS][: world.near[DRIVER_COUNT]]
    x, z = world.x, world.z
    state = scene[0][:n], scene[1][:n], scene[2][:n], scene[3][:n], scene[4][:n], scene[5][:n]
    known = z[MODEL][:n], x[DESIRED_M_S][:n], z[DRIVER_STATE][:n], z[BRAKING][:n]
    decide(state, traffic, drivers, (*known, x[WISH_M_S2][:n], z[SIDE][:n]), scratch)
    for i in drivers:
        if z[SIDE, i] != 0:
            request_change(world, net, i, z[SIDE, i], steps)


@borrowing
def happen(world: World, net: Net, i: int, event: int) -> None:
    """Let an event of ``draw_events`` happen to a vehicle."""
    if abs(event) == 1:
        request_change(world, net, i, event, REQUEST_STEPS)
    elif world.z[BRAKING, i] == 0:
        world.z[BRAKING, i] = event - 1


@borrowing
def request_change(world: World, net: Net, i: int, side: int, steps: int) -> None:
    """Request a lane change, +1 left or -1 right, for so many steps.

    None is requested of a vehicle that is not centred, as in SUMO.
    """
    lane = world.z[LANE, i] + side - net.edge_lanes[FIRST_LANE, world.z[EDGE, i]]
    if lane >= 0 and np.abs(world.x[ASIDE_M, i]) <= CENTERED_M:
        world.z[REQUEST_LANE, i] = lane
        world.z[REQUEST_END, i] = world.near[STEP] + steps
