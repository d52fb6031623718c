"""Draws the whole loop from above; traffic drives counter-clockwise, lane 0 is outside."""

import math

from drl_av.drawing.canvas import (
    AMBER,
    ASPHALT,
    BARRED,
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

_CENTER, _RADIUS, _LANES_PX = (186.0, 548.0), 146.0, 48.0


def lay_ring(sheet: Canvas, road: Road) -> None:
    """Draw the static parts of the loop: lanes, markings, barricades, and its length as text."""
    lanes = len(road.open_lanes)
    lane_px = _LANES_PX / lanes
    for lane in range(lanes):
        outer = _RADIUS - lane * lane_px
        sheet.arc(
            _CENTER, outer, (0, 360), ASPHALT if road.is_open(lane) else BARRED, lane_px + 0.5
        )
        if not road.is_open(lane):
            for start in range(0, 360, 6):
                sheet.arc(_CENTER, outer - lane_px * 0.35, (start, start + 2.5), DIM, lane_px * 0.3)
    for lane in range(1, lanes):
        for start in range(0, 360, 6):
            sheet.arc(_CENTER, _RADIUS - lane * lane_px, (start, start + 2), DIM, 1)
    sheet.arc(_CENTER, _RADIUS, (0, 360), BRIGHT, 1.5)
    sheet.arc(_CENTER, _RADIUS - _LANES_PX, (0, 360), AMBER, 1.5)
    x, y = _CENTER
    sheet.text((x, y - 4), f"{road.lap_m:g} m", 24, BRIGHT, "ms")
    sheet.text((x, y + 18), "loop", 14, DIM, "ms")
    sheet.arc(_CENTER, 74, (240, 300), DIM, 2)
    sheet.polygon([(x - 44, y - 59), (x - 32, y - 61), (x - 38, y - 71)], DIM)


def draw_ring(sheet: Canvas, snapshot: Snapshot, road: Road) -> None:
    """Draw all vehicles as dots on the loop, and an arc along the part that the overview shows."""
    lane_px = _LANES_PX / len(road.open_lanes)
    turn = math.tau / road.lap_m
    ego = -math.degrees(float(snapshot.s_m[EGO]) * turn)
    reach = [min(180.0, math.degrees(m * turn)) for m in (OVERVIEW.ahead_m, OVERVIEW.behind_m)]
    sheet.arc(_CENTER, _RADIUS + 8, (ego - reach[0], ego + reach[1]), RULE, 3)
    for row in reversed(range(len(snapshot.ids))):
        lane = float(snapshot.y_m[row]) / road.lane_width_m
        radius = _RADIUS - (lane + 0.5) * lane_px
        angle = float(snapshot.s_m[row]) * turn
        x = _CENTER[0] + radius * math.cos(angle)
        y = _CENTER[1] - radius * math.sin(angle)
        if row == EGO:
            sheet.dot((x, y), 8.5, BRIGHT)
            sheet.dot((x, y), 6.5, EGO_COLOR)
        else:
            sheet.dot((x, y), 5, speed_color(float(snapshot.speed_m_s[row])))
