"""The order in which SUMO lets the edges change lanes: that of its list of lanes with vehicles.

A strip is one lane of one edge, numbered ``rank * lanes + lane`` with the rank of the edge. SUMO
puts a strip in front of its list when a vehicle enters it empty, and takes it off when it is empty
after a step. Sets of strips are whole numbers with a bit for each.
"""

from drl_av.compiled import inlined
from drl_av.twin.worlds import ACTIVE, ACTIVE_COUNT, COUNT, EDGE, LANE, RANK, Net, World


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
