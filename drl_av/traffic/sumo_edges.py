"""The edges of an open road as SUMO has them, which may differ from those of its plan."""

import math
from itertools import chain, pairwise

from drl_av.traffic.kind import Edge, OpenPlan

RUN_OUT_M = 500.0
"""Length of SUMO's road beyond the end of the ego's way; vehicles are removed before its end."""
LONGEST_M = 2000.0
"""Length of the longest edge that is not divided (ours)."""
PIECE_M = 400.0
"""Length of the longest piece of a divided edge (ours), with which SUMO is the fastest."""


def in_sumo(plan: OpenPlan) -> OpenPlan:
    """Return a plan with the edges and routes that its road has in SUMO.

    The last edges extend beyond the end of the ego's way. A straight edge longer than ``LONGEST_M``
    is divided: for each vehicle SUMO looks at all vehicles in the same lane of the edge, so the
    time of a step would grow with the square of their number.
    """
    end_m = plan.road.end_m
    run_out_m = 0.0 if any(edge.begin_m == end_m for edge in plan.edges) else RUN_OUT_M
    pieces = {
        edge.id: _pieces(edge._replace(end_m=end_m + run_out_m) if edge.end_m == end_m else edge)
        for edge in plan.edges
    }
    routes = {
        name: tuple(piece.id for edge in edges for piece in pieces[edge])
        for name, edges in plan.routes.items()
    }
    return plan._replace(edges=tuple(chain(*pieces.values())), routes=routes)


def _pieces(edge: Edge) -> list[Edge]:
    """Return the pieces of an edge, of equal length up to a metre; the first one keeps its id."""
    length_m = edge.end_m - edge.begin_m
    if length_m <= LONGEST_M or edge.shape:
        return [edge]
    count = math.ceil(length_m / PIECE_M)
    cuts_m = [edge.begin_m + round(length_m * cut / count) for cut in range(count)] + [edge.end_m]
    first_m, last_m = edge.drawn_aside_m
    slope = (last_m - first_m) / length_m
    return [
        edge._replace(
            id=f"{edge.id}.{number}" if number else edge.id,
            begin_m=begin_m,
            end_m=end_m,
            drawn_aside_m=(
                first_m + slope * (begin_m - edge.begin_m),
                first_m + slope * (end_m - edge.begin_m),
            ),
        )
        for number, (begin_m, end_m) in enumerate(pairwise(cuts_m))
    ]
