"""The lanes of an open road that begin or end on the way, in the views near the ego."""

import math

from drl_av.drawing.band import Band
from drl_av.drawing.sheet import ALARM, AMBER, BRIGHT, GROUND, Sheet
from drl_av.traffic.road import PartialLane, Road

LINE_PX = 2.0


def draw_partial_lanes(sheet: Sheet, band: Band, ego_s_m: float, road: Road) -> None:
    """Draw the edges of the road, and the lanes that begin or end only where they are."""
    partial = {part.lane for part in road.partial_lanes}
    full = [lane for lane in range(len(road.open_lanes)) if lane not in partial]
    for lane in sorted(partial):
        _clear(sheet, band, road, lane, ego_s_m)
    left_m = road.center_m(max(full)) + road.lane_width_m / 2
    right_m = road.center_m(min(full)) - road.lane_width_m / 2
    _line(sheet, band, road, left_m, (-math.inf, math.inf), AMBER)
    joined = [part for part in road.partial_lanes if part.lane == min(full) - 1]
    begin_m = -math.inf
    for part in joined:
        _line(sheet, band, road, right_m, (begin_m, part.joined_from_m - ego_s_m), BRIGHT)
        begin_m = part.joined_to_m - ego_s_m
    _line(sheet, band, road, right_m, (begin_m, math.inf), BRIGHT)
    for part in road.partial_lanes:
        _outer_edge(sheet, band, road, part, ego_s_m)


def _clear(sheet: Sheet, band: Band, road: Road, lane: int, ego_s_m: float) -> None:
    """Cover a lane where it does not exist."""
    begin_m = -math.inf
    ends_m = sorted((part.begin_m, part.end_m) for part in road.partial_lanes if part.lane == lane)
    for next_m, end_m in ends_m:
        _box(sheet, band, road, lane, (begin_m, next_m - ego_s_m))
        begin_m = end_m - ego_s_m
    _box(sheet, band, road, lane, (begin_m, math.inf))


def _box(sheet: Sheet, band: Band, road: Road, lane: int, ahead_m: tuple[float, float]) -> None:
    left, right = (_column(band, at_m) for at_m in ahead_m)
    center_m, half_m = road.center_m(lane), road.lane_width_m / 2
    upper = band.y(road, center_m + half_m) + band.lane_px / 8
    lower = band.y(road, center_m - half_m) + band.lane_px / 8
    if left < right:
        sheet.box((left, upper, right, lower + 1), GROUND)


def _outer_edge(sheet: Sheet, band: Band, road: Road, part: PartialLane, ego_s_m: float) -> None:
    """Draw the right edge of a lane, and a bar where it ends."""
    center_m, half_m = road.center_m(part.lane), road.lane_width_m / 2
    ends_m = (part.begin_m - ego_s_m, part.end_m - ego_s_m)
    _line(sheet, band, road, center_m - half_m, ends_m, BRIGHT)
    if -band.behind_m < ends_m[1] < band.ahead_m:
        x = band.x(ends_m[1])
        upper, lower = band.y(road, center_m + half_m), band.y(road, center_m - half_m)
        sheet.line([(x, upper), (x, lower)], ALARM, 2 * LINE_PX)


def _line(
    sheet: Sheet,
    band: Band,
    road: Road,
    y_m: float,
    ahead_m: tuple[float, float],
    color: tuple[int, int, int],
) -> None:
    left, right = (_column(band, at_m) for at_m in ahead_m)
    if left < right:
        sheet.line([(left, band.y(road, y_m)), (right, band.y(road, y_m))], color, LINE_PX)


def _column(band: Band, ahead_m: float) -> float:
    """The column of a place, within the band."""
    return band.x(min(max(ahead_m, -band.behind_m), band.ahead_m))
