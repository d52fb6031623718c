"""The carriageway that a route through a network follows, and the exit by which it may leave it."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from drl_av.errors import ScenarioError, pluralize
from drl_av.road.road import PartialLane, SpeedLimit
from drl_av.scenarios.highways import AFTER_M
from drl_av.scenarios.imported.curves import Line, Span, curve_limits
from drl_av.scenarios.imported.route import Route, Section, shifted

SHORTEST_EXIT_LANE_M = 50.0
"""Smallest length of the lane that leads to an exit (ours), as in the kind ``exit``."""


class Carriageway(NamedTuple):
    """The road that a route follows, up to its exit if it has one, and the off-ramp there."""

    sections: tuple[Section, ...]
    """The edges of the route, up to the exit if the route has one; lane 0 is the rightmost."""
    through: tuple[int, ...]
    """Indices of the lanes that extend along all ``sections``, rightmost first."""
    off_ramp: tuple[Section, ...] = ()
    """The edges after the exit, with the lane indices of the ``Route``; empty without an exit."""

    @property
    def driven(self) -> tuple[Section, ...]:
        """The edges on which the ego may drive."""
        return (*self.sections, *(one for one in self.off_ramp if one.begin_m < self.end_m))

    @property
    def left_out_m(self) -> float:
        """Length of the route behind the off-ramp, metres; 0 without an exit."""
        return max(self.off_ramp[-1].end_m - self.end_m, 0.0) if self.off_ramp else 0.0

    @property
    def end_m(self) -> float:
        """Position where the ego's way ends, metres along the route; ``AFTER_M`` after an exit."""
        return self.sections[-1].end_m + (AFTER_M if self.off_ramp else 0.0)

    @property
    def exit_m(self) -> float:
        """The position where the off-ramp separates from the carriageway; inf without an exit."""
        return self.sections[-1].end_m if self.off_ramp else math.inf

    @property
    def exit_lanes(self) -> range:
        """Indices of the lanes that lead to the off-ramp; the rightmost ones, or none."""
        return self.sections[-1].leading_on if self.off_ramp else range(0)

    @property
    def on_ramp(self) -> Section | None:
        """The last edge of the ramp on which the route begins; None if it begins on the motorway.

        Other roads join there, and fewer than half of the lanes come from a ramp.
        """
        for before, after in pairwise(self.sections):
            if before.joining and 2 * len(before.leading_on) < len(after.lanes):
                return before
        return None

    def measured(self) -> Iterator[tuple[tuple[str, int], Span]]:
        """Yield each edge and lane on which the ego may drive, and where its curves are measured.

        The lanes of a ramp are measured along it, too, and all others along the motorway alone.
        """
        ramp, last = self.on_ramp, self.sections[-1]
        for section in self.driven:
            for lane in section.lanes:
                begin_m, end_m = 0.0, math.inf
                if ramp and section.begin_m >= ramp.end_m and lane not in ramp.leading_on:
                    begin_m = ramp.end_m
                if section.begin_m < self.exit_m < math.inf and lane not in self.exit_lanes:
                    end_m = last.junction_m
                yield (section.edge, lane), (begin_m, end_m)

    @property
    def other_roads(self) -> str:
        """A phrase for the roads that join or leave the route before its end; "" without any.

        Where the route has an exit, the motorway that goes on there is none of them.
        """
        passed = self.sections[:-1]
        joining = {edge for section in passed for edge in section.joining}
        leaving = {edge for section in passed for edge in section.leaving}
        phrases = [
            f"{pluralize(len(roads), 'road')} that {verb}{'s' if len(roads) == 1 else ''} it"
            for roads, verb in ((joining, "join"), (leaving, "leave"))
            if roads
        ]
        whose = "its" if len(joining) + len(leaving) == 1 else "their"
        return f"{' and '.join(phrases)}, with {whose} traffic" if phrases else ""

    @property
    def partial_lanes(self) -> tuple[PartialLane, ...]:
        """The lanes that do not lead along all ``sections``, in the order in which they begin.

        If the leftmost of the ``exit_lanes`` is one of them, vehicles may change between it and the
        lane to its left only before ``exit_m``, where the off-ramp begins.
        """
        parting = (max(self.exit_lanes, default=None), math.inf)
        return tuple(
            part._replace(joined_to_m=self.exit_m) if (part.lane, part.end_m) == parting else part
            for part in partial_lanes(self.sections)
        )


def carriageway(route: Route) -> Carriageway:
    """Return the carriageway of a route.

    The route has an exit after an edge if none of the lanes that extend from the beginning of the
    route to this edge leads to the next edge of the route, but one of them leads to another edge.
    Fewer than half of the lanes lead to an exit; otherwise the motorway itself turns off there.

    Raises:
        ScenarioError: no lane leads along the whole route or to an exit on the right, or the lane
            of the exit is too short; the message completes a sentence "The route ...".
    """
    through = set(route.sections[0].lanes)
    for number, section in enumerate(route.sections[:-1], 1):
        if not through & {*section.leading_on}:
            return _leave(route.sections[:number], through, route.sections[number:])
        through &= {*section.leading_on}
    return Carriageway(route.sections, tuple(sorted(through)))


def _leave(
    before: tuple[Section, ...], through: set[int], after: tuple[Section, ...]
) -> Carriageway:
    """Return the carriageway of a route with an exit; raise ScenarioError if it cannot be used."""
    last, off_ramp = before[-1], after[0].edge
    if not through & last.leading_away:
        raise ScenarioError(
            f"has no lane that leads along all of it, only up to the end of edge {last.edge!r} at "
            f"{last.end_m:.0f} m: end it there, or begin it later."
        )
    if 2 * len(last.leading_on) >= len(last.lanes):
        raise ScenarioError(
            f"goes on along the motorway from edge {last.edge!r} to edge {off_ramp!r}, but the "
            "lanes in which it begins lead elsewhere: begin it on the motorway, not on a ramp, or "
            f"end it on edge {last.edge!r}."
        )
    if last.leading_on[0] != last.lanes[0]:
        raise ScenarioError(
            f"leaves edge {last.edge!r} for edge {off_ramp!r} by a lane with other lanes to its "
            "right, but an exit must be on the right: choose another route."
        )
    rightmost = min(section.lanes[0] for section in before)
    sections = tuple(_moved(section, -rightmost) for section in before)
    found = Carriageway(sections, tuple(sorted(lane - rightmost for lane in through)), after)
    [begin_m] = [
        part.begin_m
        for part in found.partial_lanes
        if part.joined_to_m == found.exit_m < part.end_m
    ]
    length_m = found.exit_m - begin_m
    if length_m < SHORTEST_EXIT_LANE_M:
        raise ScenarioError(
            f"leaves edge {last.edge!r} for edge {off_ramp!r} by a lane of "
            f"{length_m:.0f} m, but it must have {SHORTEST_EXIT_LANE_M:g} m: "
            "lengthen it in netedit, or choose another route."
        )
    return found


def lane_curves(
    way: Carriageway, line: Line, sideways_m_s2: float, fastest_m_s: float
) -> dict[tuple[str, int], tuple[SpeedLimit, ...]]:
    """Return the curves of each edge and lane on which the ego may drive (``curve_limits``)."""
    spans = dict(way.measured())
    found = {
        span: curve_limits(line, sideways_m_s2, fastest_m_s, span) for span in set(spans.values())
    }
    return {
        place: tuple(curve for curve in found[span] if curve.begin_m < way.end_m)
        for place, span in spans.items()
    }


def _moved(section: Section, lanes: int) -> Section:
    """Return a section whose lane indices are higher by ``lanes``."""
    return section._replace(
        parts=tuple(
            part._replace(attributes={lane + lanes: kept for lane, kept in part.attributes.items()})
            for part in section.parts
        ),
        lanes=shifted(section.lanes, lanes),
        leading_on=shifted(section.leading_on, lanes),
        leading_away=frozenset(lane + lanes for lane in section.leading_away),
    )


def partial_lanes(sections: Sequence[Section]) -> tuple[PartialLane, ...]:
    """Return the lanes that do not lead along all sections, in the order in which they begin.

    A lane of the last section has no end: its ``end_m`` is inf.
    """
    begun = dict.fromkeys(sections[0].lanes, 0.0)
    found = []
    for section in sections[:-1]:
        for lane in section.lanes:
            begun.setdefault(lane, section.begin_m)
        ended = {*section.lanes} - {*section.leading_on}
        found += [(begun.pop(lane), section.end_m, lane) for lane in sorted(ended)]
    last = {lane: begun.get(lane, sections[-1].begin_m) for lane in sections[-1].lanes}
    found += [(begin_m, math.inf, lane) for lane, begin_m in last.items() if begin_m > 0.0]
    return tuple(PartialLane(lane, *[begin_m, end_m] * 2) for begin_m, end_m, lane in sorted(found))
