"""Draws a picture of a scene without a screen: road near the ego, loop and panels."""

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps

from drl_av.drawing.canvas import (
    AMBER,
    ASPHALT,
    BARRED,
    BRIGHT,
    CANVAS_SIZE,
    DIM,
    EGO_COLOR,
    GROUND,
    OVERSAMPLING,
    RULE,
    Canvas,
    speed_color,
)
from drl_av.drawing.panels import (
    Caption,
    draw_decision,
    draw_header,
    draw_history,
    draw_reward,
    lay_cards,
    lay_legend,
)
from drl_av.drawing.road_view import CLOSE_UP, OVERVIEW, draw_strip, lay_asphalt, lay_marks
from drl_av.road.road import Road, is_open
from drl_av.road.snapshot import EGO, Snapshot

_CENTER, _RADIUS, _LANES_PX = (186.0, 548.0), 146.0, 48.0


def lay_ring(canvas: Canvas, road: Road) -> None:
    """Draw the static parts of the loop: lanes, markings, barricades, and its length as text."""
    lanes = len(road.open_lanes)
    lane_px = _LANES_PX / lanes
    for lane in range(lanes):
        outer = _RADIUS - lane * lane_px
        canvas.arc(
            _CENTER, outer, (0, 360), ASPHALT if is_open(lane, road) else BARRED, lane_px + 0.5
        )
        if not is_open(lane, road):
            for start in range(0, 360, 6):
                canvas.arc(
                    _CENTER, outer - lane_px * 0.35, (start, start + 2.5), DIM, lane_px * 0.3
                )
    for lane in range(1, lanes):
        for start in range(0, 360, 6):
            canvas.arc(_CENTER, _RADIUS - lane * lane_px, (start, start + 2), DIM, 1)
    canvas.arc(_CENTER, _RADIUS, (0, 360), BRIGHT, 1.5)
    canvas.arc(_CENTER, _RADIUS - _LANES_PX, (0, 360), AMBER, 1.5)
    x, y = _CENTER
    canvas.text((x, y - 4), f"{road.lap_m:g} m", 24, BRIGHT, "ms")
    canvas.text((x, y + 18), "loop", 14, DIM, "ms")
    canvas.arc(_CENTER, 74, (240, 300), DIM, 2)
    canvas.polygon([(x - 44, y - 59), (x - 32, y - 61), (x - 38, y - 71)], DIM)


def draw_ring(canvas: Canvas, snapshot: Snapshot, road: Road) -> None:
    """Draw all vehicles as dots on the loop, and an arc along the part that the overview shows."""
    lane_px = _LANES_PX / len(road.open_lanes)
    turn = math.tau / road.lap_m
    ego = -math.degrees(float(snapshot.s_m[EGO]) * turn)
    reach = [min(180.0, math.degrees(m * turn)) for m in (OVERVIEW.ahead_m, OVERVIEW.behind_m)]
    canvas.arc(_CENTER, _RADIUS + 8, (ego - reach[0], ego + reach[1]), RULE, 3)
    for row in reversed(range(len(snapshot.ids))):
        lane = float(snapshot.y_m[row]) / road.lane_width_m
        radius = _RADIUS - (lane + 0.5) * lane_px
        angle = float(snapshot.s_m[row]) * turn
        x = _CENTER[0] + radius * math.cos(angle)
        y = _CENTER[1] - radius * math.sin(angle)
        if row == EGO:
            canvas.dot((x, y), 8.5, BRIGHT)
            canvas.dot((x, y), 6.5, EGO_COLOR)
        else:
            canvas.dot((x, y), 5, speed_color(float(snapshot.speed_m_s[row])))


_LEFT, _RIGHT, _MIDDLE, _LANE_PX = 36.0, 336.0, 540.0, 16.0
BEYOND_M = 250.0
"""Length of road that is drawn beyond the end of the ego's way."""


def _x(road: Road, s_m: float) -> float:
    share = min(max(s_m / (road.end_m + BEYOND_M), 0.0), 1.0)
    return _LEFT + share * (_RIGHT - _LEFT)


def _y(road: Road, y_m: float) -> float:
    return _MIDDLE + ((len(road.open_lanes) - 1) / 2 - y_m / road.lane_width_m) * _LANE_PX


def lay_open_road(canvas: Canvas, road: Road) -> None:
    """Draw the static parts of the road: each lane where it exists, and the end of the way."""
    parts = [(part.lane, part.begin_m, part.end_m) for part in road.partial_lanes]
    partial = {lane for lane, _, _ in parts}
    whole = [lane for lane in range(len(road.open_lanes)) if lane not in partial]
    for lane, begin_m, end_m in [*parts, *((lane, 0.0, road.lap_m) for lane in whole)]:
        middle = _y(road, road.center_m(lane))
        edges = (_x(road, begin_m), middle - 7.5, _x(road, end_m), middle + 7.5)
        canvas.box(edges, ASPHALT)
    x, top = _x(road, road.end_m), _y(road, road.center_m(len(road.open_lanes) - 1)) - 12
    bottom = _y(road, 0.0) + 12
    canvas.line([(x, top), (x, bottom)], AMBER, 1.5)
    canvas.text((x, bottom + 16), f"{road.end_m:.0f} m", 14, DIM, "ms")
    canvas.text((_LEFT, bottom + 16), "0", 14, DIM, "ms")


def draw_open_road(canvas: Canvas, snapshot: Snapshot, road: Road) -> None:
    """Draw all vehicles as dots, and the part of the road that the overview shows."""
    ego_m, bottom = float(snapshot.s_m[EGO]), _y(road, 0.0) + 12
    ends = (_x(road, ego_m - OVERVIEW.behind_m), _x(road, ego_m + OVERVIEW.ahead_m))
    canvas.line([(ends[0], bottom), (ends[1], bottom)], RULE, 3)
    for row in reversed(range(len(snapshot.ids))):
        place = (_x(road, float(snapshot.s_m[row])), _y(road, float(snapshot.y_m[row])))
        if row == EGO:
            canvas.dot(place, 7.5, BRIGHT)
            canvas.dot(place, 5.5, EGO_COLOR)
        else:
            canvas.dot(place, 2.5, speed_color(float(snapshot.speed_m_s[row])))


Picture = npt.NDArray[np.uint8]


def draw(
    snapshot: Snapshot, road: Road, caption: Caption, size: tuple[int, int] = CANVAS_SIZE
) -> Picture:
    """Draw one scene and return the picture, uint8 of shape (height, width, 3).

    ``size`` is (width, height) in px. The layout is scaled to fit; if the aspect ratio differs, it
    gets bars at its sides.
    """
    canvas = Canvas(_background(road).copy())
    for strip in (CLOSE_UP, OVERVIEW):
        draw_strip(canvas, strip, snapshot, road)
    if road.is_loop:
        draw_ring(canvas, snapshot, road)
    else:
        draw_open_road(canvas, snapshot, road)
    draw_header(canvas, snapshot, caption)
    draw_decision(canvas, snapshot, caption)
    draw_reward(canvas, caption)
    draw_history(canvas, caption)
    image = canvas.image.reduce(OVERSAMPLING)
    if size != CANVAS_SIZE:
        image = ImageOps.pad(image, size, Image.Resampling.LANCZOS, color=GROUND)
    return np.array(image, dtype=np.uint8)


@lru_cache(maxsize=8)
def _background(road: Road) -> Image.Image:
    """Return the image of the static parts. It is cached: copy it before drawing on it."""
    width, height = CANVAS_SIZE
    size = (OVERSAMPLING * width, OVERSAMPLING * height)
    canvas = Canvas(Image.new("RGB", size, GROUND))
    for strip in (CLOSE_UP, OVERVIEW):
        lay_asphalt(canvas, strip, road)
    lay_marks(canvas)
    lay_cards(canvas)
    if road.is_loop:
        lay_ring(canvas, road)
    else:
        lay_open_road(canvas, road)
    lay_legend(canvas)
    return canvas.image
