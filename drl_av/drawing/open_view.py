"""Draws a whole open road from above, from its beginning at the left to its end at the right."""

from drl_av.drawing.canvas import (
    AMBER,
    ASPHALT,
    BRIGHT,
    DIM,
    EGO_COLOR,
    RULE,
    Canvas,
    speed_color,
)
from drl_av.drawing.road_view import OVERVIEW
from drl_av.road.road import Road
from drl_av.road.snapshot import EGO, Snapshot

_LEFT, _RIGHT, _MIDDLE, _LANE_PX = 36.0, 336.0, 540.0, 16.0
BEYOND_M = 250.0
"""Length of road that is drawn beyond the end of the ego's way."""


def _x(road: Road, s_m: float) -> float:
    share = min(max(s_m / (road.end_m + BEYOND_M), 0.0), 1.0)
    return _LEFT + share * (_RIGHT - _LEFT)


def _y(road: Road, y_m: float) -> float:
    return _MIDDLE + ((len(road.open_lanes) - 1) / 2 - y_m / road.lane_width_m) * _LANE_PX


def lay_open_road(sheet: Canvas, road: Road) -> None:
    """Draw the static parts of the road: each lane where it exists, and the end of the way."""
    parts = [(part.lane, part.begin_m, part.end_m) for part in road.partial_lanes]
    partial = {lane for lane, _, _ in parts}
    whole = [lane for lane in range(len(road.open_lanes)) if lane not in partial]
    for lane, begin_m, end_m in [*parts, *((lane, 0.0, road.lap_m) for lane in whole)]:
        middle = _y(road, road.center_m(lane))
        edges = (_x(road, begin_m), middle - 7.5, _x(road, end_m), middle + 7.5)
        sheet.box(edges, ASPHALT)
    x, top = _x(road, road.end_m), _y(road, road.center_m(len(road.open_lanes) - 1)) - 12
    bottom = _y(road, 0.0) + 12
    sheet.line([(x, top), (x, bottom)], AMBER, 1.5)
    sheet.text((x, bottom + 16), f"{road.end_m:.0f} m", 14, DIM, "ms")
    sheet.text((_LEFT, bottom + 16), "0", 14, DIM, "ms")


def draw_open_road(sheet: Canvas, snapshot: Snapshot, road: Road) -> None:
    """Draw all vehicles as dots, and the part of the road that the overview shows."""
    ego_m, bottom = float(snapshot.s_m[EGO]), _y(road, 0.0) + 12
    ends = (_x(road, ego_m - OVERVIEW.behind_m), _x(road, ego_m + OVERVIEW.ahead_m))
    sheet.line([(ends[0], bottom), (ends[1], bottom)], RULE, 3)
    for row in reversed(range(len(snapshot.ids))):
        place = (_x(road, float(snapshot.s_m[row])), _y(road, float(snapshot.y_m[row])))
        if row == EGO:
            sheet.dot(place, 7.5, BRIGHT)
            sheet.dot(place, 5.5, EGO_COLOR)
        else:
            sheet.dot(place, 2.5, speed_color(float(snapshot.speed_m_s[row])))
