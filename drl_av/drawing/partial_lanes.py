"""Draws the lanes that begin or end on an open road, in the two views of the road near the ego."""

import math
from collections.abc import Iterator
from itertools import pairwise

from drl_av.drawing.band import RoadStrip
from drl_av.drawing.canvas import ALARM, AMBER, BRIGHT, GROUND, Canvas
from drl_av.road.road import PartialLane, Road

LINE_PX = 2.0
FAR_M = 1e6
"""A distance beyond the ends of every open road."""


def draw_partial_lanes(sheet: Canvas, band: RoadStrip, ego_s_m: float, road: Road) -> None:
    """Draw where the lanes of an open road begin and end, on a sheet that shows all lanes.

    The function covers each partial lane where it does not exist. It draws solid lines along both
    sides of the road and between divided lanes, and a bar where a lane ends. ``ego_s_m`` is the
    ego's position along the road, metres.
    """
    for lane in sorted({part.lane for part in road.partial_lanes}):
        _clear(sheet, band, road, lane, ego_s_m)
    for line in range(len(road.open_lanes) + 1):
        y_m = road.center_m(line) - road.lane_width_m / 2
        for begin_m, end_m, color in solid_lines(road, line):
            _line(sheet, band, road, y_m, (begin_m - ego_s_m, end_m - ego_s_m), color)
    for part in road.partial_lanes:
        _end(sheet, band, road, part, ego_s_m)


def solid_lines(road: Road, line: int) -> Iterator[tuple[float, float, tuple[int, int, int]]]:
    """Yield (begin_m, end_m, colour) of each solid part of a line along the road.

    ``line`` is the index of the lane to the left of the line. The line is solid at the edges of the
    road, and where the lanes on its two sides are divided.
    """
    parts = [part for part in road.partial_lanes if part.lane in (line - 1, line)]
    ends_m = {-FAR_M, FAR_M}
    for part in parts:
        ends_m |= {part.begin_m, part.end_m, part.joined_from_m, part.joined_to_m}
    for begin_m, end_m in pairwise(sorted(ends_m)):
        middle_m = (begin_m + min(end_m, FAR_M)) / 2
        right, left = (road.is_open_at(lane, middle_m) for lane in (line - 1, line))
        if left != right:
            yield begin_m, end_m, AMBER if right else BRIGHT
        elif left and not road.is_beside(line - 1, line, middle_m):
            yield begin_m, end_m, BRIGHT


def _clear(sheet: Canvas, band: RoadStrip, road: Road, lane: int, ego_s_m: float) -> None:
    """Cover a lane where it does not exist."""
    begin_m = -math.inf
    ends_m = sorted((part.begin_m, part.end_m) for part in road.partial_lanes if part.lane == lane)
    for next_m, end_m in ends_m:
        _box(sheet, band, road, lane, (begin_m, next_m - ego_s_m))
        begin_m = end_m - ego_s_m
    _box(sheet, band, road, lane, (begin_m, math.inf))


def _box(
    sheet: Canvas, band: RoadStrip, road: Road, lane: int, ahead_m: tuple[float, float]
) -> None:
    left, right = (_column(band, at_m) for at_m in ahead_m)
    center_m, half_m = road.center_m(lane), road.lane_width_m / 2
    outward = -1 if not all(map(road.is_partial, range(lane))) else 1
    verge = outward * band.lane_px / 8
    upper = band.y(road, center_m + half_m) + verge
    lower = band.y(road, center_m - half_m) + verge
    if left < right:
        sheet.box((left, upper, right, lower + 1), GROUND)


def _end(sheet: Canvas, band: RoadStrip, road: Road, part: PartialLane, ego_s_m: float) -> None:
    """Draw a bar where a lane ends."""
    end_m = part.end_m - ego_s_m
    if -band.behind_m < end_m < band.ahead_m:
        x, half_m = band.x(end_m), road.lane_width_m / 2
        upper, lower = (band.y(road, road.center_m(part.lane) + side) for side in (half_m, -half_m))
        sheet.line([(x, upper), (x, lower)], ALARM, 2 * LINE_PX)


def _line(
    sheet: Canvas,
    band: RoadStrip,
    road: Road,
    y_m: float,
    ahead_m: tuple[float, float],
    color: tuple[int, int, int],
) -> None:
    left, right = (_column(band, at_m) for at_m in ahead_m)
    if left < right:
        sheet.line([(left, band.y(road, y_m)), (right, band.y(road, y_m))], color, LINE_PX)


def _column(band: RoadStrip, ahead_m: float) -> float:
    """Return the x coordinate, px, of a point ``ahead_m`` ahead of the ego, limited to the band."""
    return band.x(min(max(ahead_m, -band.behind_m), band.ahead_m))
