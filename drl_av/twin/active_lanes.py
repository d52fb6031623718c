"""The order in which SUMO lets the edges change lanes: that of its list of lanes with vehicles.

A strip is one lane of one edge, numbered ``edge * lanes + lane``. SUMO puts a strip in front of its
list when a vehicle enters it empty, and takes it off when it is empty at certain moments of a step.
"""

from drl_av.compiled import borrowing
from drl_av.twin.neighbors import EDGES
from drl_av.twin.worlds import (
    ACTIVE,
    ACTIVE_COUNT,
    COUNT,
    EDGE,
    LANE,
    MARKS,
    Loop,
    World,
)

HAS_STAYED, HAS_ENTERED = 1, 2


@borrowing
def strip_of(world: World, loop: Loop, i: int) -> int:
    """Return the strip on which the front of a vehicle is."""
    return int(world.z[EDGE, i] * loop.lanes + world.z[LANE, i])


@borrowing
def forget_empty(world: World, loop: Loop, wanted: int) -> None:
    """Take the strips off the list whose marks have none of the bits ``wanted``."""
    kept = 0
    for m in range(world.near[ACTIVE_COUNT]):
        strip = world.near[ACTIVE + m]
        if world.near[MARKS + strip] & wanted:
            world.near[ACTIVE + kept] = strip
            kept += 1
    world.near[ACTIVE_COUNT] = kept


@borrowing
def put_in_front(world: World, loop: Loop, strip: int) -> None:
    """Put a strip in front of the list unless it is on it."""
    count = world.near[ACTIVE_COUNT]
    for m in range(count):
        if world.near[ACTIVE + m] == strip:
            return
    for m in range(count, 0, -1):
        world.near[ACTIVE + m] = world.near[ACTIVE + m - 1]
    world.near[ACTIVE + 0] = strip
    world.near[ACTIVE_COUNT] = count + 1


@borrowing
def mark_present(world: World, loop: Loop) -> None:
    """Mark the strips on which vehicles are now."""
    for strip in range(EDGES * loop.lanes):
        world.near[MARKS + strip] = 0
    for i in range(world.near[COUNT]):
        world.near[MARKS + strip_of(world, loop, i)] |= HAS_STAYED


@borrowing
def activate(world: World, loop: Loop) -> None:
    """Put all marked strips in front of the list, in the order of their numbers."""
    for strip in range(EDGES * loop.lanes):
        if world.near[MARKS + strip]:
            put_in_front(world, loop, strip)
