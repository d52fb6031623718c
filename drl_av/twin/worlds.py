"""The state of many worlds as arrays; column 0 of the vehicles is the ego.

A world has two tables with one column a vehicle: ``x`` holds real numbers, ``z`` whole numbers. A
row is one quantity of all vehicles, named by the constants below, in SI units. The columns beyond
the world's ``COUNT`` are unused. Everything that SUMO's models remember between two steps is in
these arrays, so a copy of them continues like the original.

Edges change lanes in the order of SUMO's list of lanes with vehicles. A strip is one lane of one
edge, numbered ``rank * lanes + lane`` with the rank of the edge. SUMO puts a strip in front of its
list when a vehicle enters it empty, and takes it off when it is empty after a step. Sets of strips
are whole numbers with a bit for each.
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import inlined

FRONT_M, SPEED_M_S, ACCELERATION_NOW_M_S2, ASIDE_M, LATERAL_SPEED_M_S, LENGTH_M = range(6)
WIDTH_M, DESIRED_M_S, HEADWAY_S, ACCELERATION_M_S2, THRESHOLD_LEFT = range(6, 11)
THRESHOLD_RIGHT, WISH_M_S2, CHOSEN_M_S, REQUESTED_M_S, MANEUVER_M, COMMANDED_M = range(11, 17)
GAIN_LEFT, GAIN_RIGHT, ADVICE_M_S, NEXT_M_S, GAP_M, ITS_M_S, LOOK_AHEAD_M_S = range(17, 24)
EXPECTED_M_S = 24
"""The rows of ``x``.

``FRONT_M`` is the position of the front bumper in [0, lap), ``ASIDE_M`` the offset of the body's
centre from the centre of its lane, left positive. ``ACCELERATION_NOW_M_S2`` is the change of the
speed in the last step divided by its length. SUMO's parameters of a driver are ``DESIRED_M_S``,
``HEADWAY_S``, ``ACCELERATION_M_S2``, and the speed gains from which it changes to the left and to
the right. ``WISH_M_S2`` is the acceleration that a driver of ours wants, nan if SUMO drives;
``REQUESTED_M_S`` is the speed requested for this step (``LEFT_TO_SUMO`` without a request), and
``CHOSEN_M_S`` the one that SUMO's models chose in the last step, which a request overrides.
``ADVICE_M_S`` bounds the next speed for the lane changes around (inf without one). ``MANEUVER_M``
is the lateral distance left of the lane change in progress, ``COMMANDED_M`` the same of one that
was requested.
``GAIN_LEFT`` and ``GAIN_RIGHT`` are SL2015's memory of faster lanes, and the rows from
``EXPECTED_M_S`` on, one a lane, the speeds that it expects there. ``LOOK_AHEAD_M_S`` is, for the
ego only, the smoothed speed by which SUMO judges how urgent a mandatory lane change is.
``NEXT_M_S``, ``GAP_M`` and ``ITS_M_S`` are scratch (``step.see_ahead``).
"""

LANE, SHADOW, RESERVED, ON_REQUEST_ONLY, REQUEST_LANE, REQUEST_END, STATE = range(7)
PREVIOUS_STATE, IS_FULL, ORDER, MASK, EDGE, MODEL, DRIVERS = range(7, 14)
DRIVER_STATE, BRAKING, SIDE, LANES, AHEAD = range(14, 19)
"""The rows of ``z``.

``SHADOW`` is the second lane that a body overlaps, ``RESERVED`` the lane that it is about to enter,
in which others make room for it; each is -1 if there is none. ``ON_REQUEST_ONLY`` is 1 if SUMO
changes the vehicle's lane on request only. A request for ``REQUEST_LANE`` (-1: none), counted as
SUMO does on each edge, stands until step ``REQUEST_END``. ``STATE`` and ``PREVIOUS_STATE`` are
SL2015's, of the flags below; ``IS_FULL`` is 1 if its last move could be made at once. ``ORDER``
lists the vehicles, the foremost first. ``MASK`` has a bit for each lane that the body overlaps.
``EDGE`` is the SUMO edge of the front bumper. ``MODEL`` is the kind of driver, a ``DriverModel``;
``DRIVERS`` lists the rows of our own, in their order. ``DRIVER_STATE`` is the state of a
finite-state machine, ``BRAKING`` for how many decisions a driver still brakes hard, ``SIDE`` the
lane change that it wants at this decision. The other rows have a column for each place in ``ORDER``
(``neighbors.link``): ``LANES`` a bit for each lane that the vehicle there overlaps or has reserved;
the rows from ``AHEAD`` on, one a lane, the place of the next vehicle ahead in the lane, -1 if there
is none; and as many after them that of the next one behind.
"""

COUNT, STEP, ACTIVE_COUNT, HAS_CHANGED = 16, 17, 18, 19
"""Entries of ``near``: the vehicles of the world, the ego included; its SUMO steps since the start;
the length of SUMO's list of the strips with vehicles (``keep_active``); and 1 if a vehicle has
changed lanes in this step."""
OVERTAKES_RIGHT, KEEPS_DISTANCE, DRIVER_COUNT, PRESENT = 20, 21, 22, 23
"""Further entries: 1 if a vehicle may be passed on the right above 60 km/h; 1 if each vehicle stays
slow enough to stop behind the one ahead; the number of drivers of our own; and the vehicles that
have not left an open road."""
ACTIVE = 24
"""First entry of ``near`` with that list."""
MOST_STRIPS = 62
"""Most strips: they are the bits of a set."""
FIRST_ON = ACTIVE + MOST_STRIPS
"""First entry of ``near`` with the foremost vehicle of each edge, as its place in ``ORDER``."""


STAY = 1
LEFT = 1 << 1
RIGHT = 1 << 2
STRATEGIC = 1 << 3
COOPERATIVE = 1 << 4
SPEED_GAIN = 1 << 5
KEEP_RIGHT = 1 << 6
REQUESTED = 1 << 7
URGENT = 1 << 8
BLOCKED_BY_LEFT_LEADER = 1 << 9
BLOCKED_BY_LEFT_FOLLOWER = 1 << 10
BLOCKED_BY_RIGHT_LEADER = 1 << 11
BLOCKED_BY_RIGHT_FOLLOWER = 1 << 12
OVERLAPPING = 1 << 13
SUBLANE = 1 << 15
"""A move within the lane, to its centre."""
IS_BLOCKING_LEADER = 1 << 16
IS_BLOCKING_FOLLOWER = 1 << 17
ASKED_BY_RIGHTWARD = 1 << 18
"""The vehicle that asks for room changes to the right."""
ASKED_BY_LEFTWARD = 1 << 19

WANTS = LEFT | RIGHT
REASONS = STRATEGIC | COOPERATIVE | SPEED_GAIN | KEEP_RIGHT | SUBLANE | REQUESTED
FULL_REASONS = STRATEGIC | COOPERATIVE | SPEED_GAIN | KEEP_RIGHT
BLOCKED_LEFT = BLOCKED_BY_LEFT_LEADER | BLOCKED_BY_LEFT_FOLLOWER
BLOCKED_RIGHT = BLOCKED_BY_RIGHT_LEADER | BLOCKED_BY_RIGHT_FOLLOWER
BLOCKED_BY_LEADER = BLOCKED_BY_LEFT_LEADER | BLOCKED_BY_RIGHT_LEADER
BLOCKED_BY_FOLLOWER = BLOCKED_BY_LEFT_FOLLOWER | BLOCKED_BY_RIGHT_FOLLOWER
BLOCKED = BLOCKED_LEFT | BLOCKED_RIGHT
ASKED = IS_BLOCKING_LEADER | IS_BLOCKING_FOLLOWER | ASKED_BY_RIGHTWARD | ASKED_BY_LEFTWARD
"""The states of SUMO's lane-change models, as bits (SUMO's LaneChangeAction)."""


class World(NamedTuple):
    """One world: views of the arrays of many ``Worlds``."""

    x: FloatArray
    """Real numbers, shape (rows, vehicles)."""
    z: npt.NDArray[Any]
    """Whole numbers of 32 bits, of which more worlds fit in a cache, shape (rows, vehicles)."""
    notes: FloatArray
    """Scratch numbers of the vehicle that considers a lane change, shape (16,)."""
    near: IntArray
    """The vehicles around that vehicle, and counts of the world, shape (147,)."""


Worlds = World
"""Many worlds on one road; the first axis of each array is the world."""

EDGE_BEGIN, EDGE_LENGTH, EDGE_ROUTE = range(3)
"""The rows of ``Net.edges_m``."""
FIRST_LANE, FIRST_SEEN, RANK, BY_RANK = range(4)
"""The rows of ``Net.edge_lanes``."""


class Net(NamedTuple):
    """The road of all worlds: SUMO's edges, one after the other, and lanes along all of them."""

    lap_m: float
    """The length of a lap, after which position 0 comes; an open road ends long before it."""
    edges_m: FloatArray
    """Shape (3, edges): where each edge begins; its length, to the end of which drivers see; and
    the length of the road ahead that SUMO regards from its beginning."""
    edge_lanes: IntArray
    """Shape (4, edges): the rightmost lane of each edge, which SUMO counts as its lane 0; the
    rightmost one that is not barricaded, which may lead elsewhere; the place of the edge in SUMO's
    order, which is that of their names; and the edge at each place."""
    edges: int
    is_loop: bool
    """Whether the first edge follows the last one."""
    lane_m: float
    lanes: int
    first_open: int
    """The rightmost lane that the traffic's route follows."""
    last_open: int
    limit_m_s: float
    """SUMO's speed limit of the road."""


def empty_worlds(worlds: int, vehicles: int, lanes: int) -> Worlds:
    """Return the arrays of ``worlds`` worlds for up to ``vehicles`` vehicles, the ego included."""
    return Worlds(
        x=np.zeros((worlds, EXPECTED_M_S + lanes, vehicles)),
        z=np.zeros((worlds, AHEAD + 2 * lanes, vehicles), dtype=np.int32),
        notes=np.zeros((worlds, 16)),
        near=np.zeros((worlds, FIRST_ON + MOST_STRIPS), dtype=np.int64),
    )


@inlined
def strip_of(world: World, net: Net, i: int) -> int:
    """Return the strip on which the front of a vehicle is."""
    return int(net.edge_lanes[RANK, world.z[EDGE, i]] * net.lanes + world.z[LANE, i])


@inlined
def strips_with_vehicles(world: World, net: Net) -> int:
    """Return the set of the strips on which vehicles are now."""
    strips = 0
    for i in range(world.near[COUNT]):
        strips |= 1 << strip_of(world, net, i)
    return strips


@inlined
def keep_active(world: World, strips: int) -> None:
    """Take all other strips off the list."""
    near, kept = world.near, 0
    for m in range(near[ACTIVE_COUNT]):
        strip = near[ACTIVE + m]
        if strips >> strip & 1:
            near[ACTIVE + kept] = strip
            kept += 1
    near[ACTIVE_COUNT] = kept


@inlined
def activate(world: World, strips: int) -> None:
    """Put those strips in front of the list that are not on it, in the order of their numbers."""
    near = world.near
    for m in range(near[ACTIVE_COUNT]):
        strips &= ~(1 << near[ACTIVE + m])
    strip = 0
    while strips >> strip:
        if strips >> strip & 1:
            for m in range(near[ACTIVE_COUNT], 0, -1):
                near[ACTIVE + m] = near[ACTIVE + m - 1]
            near[ACTIVE] = strip
            near[ACTIVE_COUNT] += 1
        strip += 1
