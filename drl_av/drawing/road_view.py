"""The road near the ego as a straight strip, in a close-up and in an overview."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from drl_av.drawing.canvas import (
    ALARM,
    AMBER,
    ASPHALT,
    BARRED,
    BRIGHT,
    CANVAS_SIZE,
    DARK,
    DIM,
    EGO_COLOR,
    GROUND,
    Canvas,
    Point,
    speed_color,
)
from drl_av.road.road import PartialLane, Road, is_beside, is_open, is_open_at, is_partial
from drl_av.road.snapshot import EGO, Snapshot


@dataclass(frozen=True)
class RoadStrip:
    """A view of the road around the ego as a horizontal strip; traffic drives to the right."""

    top: int
    """Upper edge of the leftmost lane of a road with three lanes, px."""
    lane_px: int
    """Width of a lane of a road with up to three lanes, px."""
    behind_m: float
    """Length of the road that is drawn behind the ego; ``ahead_m`` is that ahead of the ego."""
    ahead_m: float
    left: int = 20
    right: int = 1260

    @property
    def px_per_m(self) -> float:
        """Scale along the road, px per metre."""
        return (self.right - self.left) / (self.behind_m + self.ahead_m)

    def x(self, ahead_m: float) -> float:
        """Return the x coordinate of a point ``ahead_m`` metres ahead of the ego, px."""
        return self.left + (ahead_m + self.behind_m) * self.px_per_m

    def y(self, road: Road, y_m: float) -> float:
        """Return the y coordinate of the lateral position ``y_m``, px; left of the ego is up."""
        lanes = len(road.open_lanes)
        lane_px = min(self.lane_px, 3 * self.lane_px / lanes)
        middle = self.top + 1.5 * self.lane_px
        return middle - (y_m / road.lane_width_m - (lanes - 1) / 2) * lane_px


LINE_PX = 2.0
FAR_M = 1e6
"""A distance beyond the ends of every open road."""


def draw_partial_lanes(canvas: Canvas, strip: RoadStrip, ego_s_m: float, road: Road) -> None:
    """Draw where the lanes of an open road begin and end, on a canvas that shows all lanes.

    The function covers each partial lane where it does not exist. It draws solid lines along both
    sides of the road and between divided lanes, and a bar where a lane ends. ``ego_s_m`` is the
    ego's position along the road, metres.
    """
    for lane in sorted({part.lane for part in road.partial_lanes}):
        _clear(canvas, strip, road, lane, ego_s_m)
    for line in range(len(road.open_lanes) + 1):
        y = strip.y(road, road.center_m(line) - road.lane_width_m / 2)
        for begin_m, end_m, color in solid_lines(road, line):
            left, right = (_column(strip, at_m - ego_s_m) for at_m in (begin_m, end_m))
            if left < right:
                canvas.line([(left, y), (right, y)], color, LINE_PX)
    for part in road.partial_lanes:
        _end(canvas, strip, road, part, ego_s_m)


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
        right, left = (is_open_at(lane, middle_m, road) for lane in (line - 1, line))
        if left != right:
            yield begin_m, end_m, AMBER if right else BRIGHT
        elif left and not is_beside(line - 1, line, middle_m, road):
            yield begin_m, end_m, BRIGHT


def _clear(canvas: Canvas, strip: RoadStrip, road: Road, lane: int, ego_s_m: float) -> None:
    """Cover a lane where it does not exist."""
    begin_m = -math.inf
    ends_m = sorted((part.begin_m, part.end_m) for part in road.partial_lanes if part.lane == lane)
    for next_m, end_m in ends_m:
        _box(canvas, strip, road, lane, (begin_m, next_m - ego_s_m))
        begin_m = end_m - ego_s_m
    _box(canvas, strip, road, lane, (begin_m, math.inf))


def _box(
    canvas: Canvas, strip: RoadStrip, road: Road, lane: int, ahead_m: tuple[float, float]
) -> None:
    left, right = (_column(strip, at_m) for at_m in ahead_m)
    center_m, half_m = road.center_m(lane), road.lane_width_m / 2
    outward = -1 if not all(is_partial(right, road) for right in range(lane)) else 1
    verge = outward * strip.lane_px / 8
    upper = strip.y(road, center_m + half_m) + verge
    lower = strip.y(road, center_m - half_m) + verge
    if left < right:
        canvas.box((left, upper, right, lower + 1), GROUND)


def _end(canvas: Canvas, strip: RoadStrip, road: Road, part: PartialLane, ego_s_m: float) -> None:
    """Draw a bar where a lane ends."""
    end_m = part.end_m - ego_s_m
    if -strip.behind_m < end_m < strip.ahead_m:
        x, half_m = strip.x(end_m), road.lane_width_m / 2
        upper, lower = (
            strip.y(road, road.center_m(part.lane) + side) for side in (half_m, -half_m)
        )
        canvas.line([(x, upper), (x, lower)], ALARM, 2 * LINE_PX)


def _column(strip: RoadStrip, ahead_m: float) -> float:
    """Return the x coordinate, px, of a point ``ahead_m`` ahead of the ego, in the strip."""
    return strip.x(min(max(ahead_m, -strip.behind_m), strip.ahead_m))


_MOVING_SIDEWAYS_M_S = 0.05
DASH_M = 5.0
"""Length of a dash between two lanes."""


CLOSE_UP = RoadStrip(top=66, lane_px=60, behind_m=32.0, ahead_m=60.0)
OVERVIEW = RoadStrip(top=276, lane_px=24, behind_m=90.0, ahead_m=150.0)


def lay_marks(canvas: Canvas) -> None:
    """Draw the scale of distances from the ego, below the overview."""
    for mark_m in (-90, -50, 0, 50, 100, 150):
        anchor = {-90: "ls", 150: "rs"}.get(mark_m, "ms")
        text = "ego" if mark_m == 0 else f"{mark_m:+d} m"
        canvas.text((OVERVIEW.x(mark_m), 371), text, 12, DIM, anchor)


def lay_asphalt(canvas: Canvas, strip: RoadStrip, road: Road) -> None:
    """Draw the static parts of a strip: asphalt, road edges and barricaded lanes."""
    lanes, half = len(road.open_lanes), road.lane_width_m / 2
    verge = strip.lane_px / 8
    top = strip.y(road, road.center_m(lanes - 1) + half)
    bottom = strip.y(road, -half)
    canvas.box((strip.left, top - verge, strip.right, bottom + verge), ASPHALT)
    for lane in range(lanes):
        if not is_open(lane, road):
            upper, lower = (strip.y(road, road.center_m(lane) + side) for side in (half, -half))
            canvas.box((strip.left, upper, strip.right, lower), BARRED)
    if road.partial_lanes:
        return
    thick = 2 if strip is CLOSE_UP else 1.5
    canvas.line([(strip.left, top), (strip.right, top)], AMBER, thick)
    canvas.line([(strip.left, bottom), (strip.right, bottom)], BRIGHT, thick)


def draw_strip(canvas: Canvas, strip: RoadStrip, snapshot: Snapshot, road: Road) -> None:
    """Draw the moving parts of a strip: lanes that begin or end, markings, barricades, vehicles."""
    if road.partial_lanes:
        draw_partial_lanes(canvas, strip, float(snapshot.s_m[EGO]), road)
    _draw_markings(canvas, strip, float(snapshot.s_m[EGO]), road)
    ahead = road.ahead_m(float(snapshot.s_m[EGO]), snapshot.s_m)
    for row in reversed(range(len(snapshot.ids))):
        for lap_m in (-road.lap_m, 0.0, road.lap_m):
            ahead_m = float(ahead[row]) + lap_m
            if -strip.behind_m - 10 < ahead_m < strip.ahead_m + 10:
                _draw_vehicle(canvas, strip, snapshot, road, row, ahead_m)
    edge = CANVAS_SIZE[0]
    for left, right in ((0, strip.left), (strip.right, edge)):
        canvas.box((left, strip.top - 12, right, strip.top + 3 * strip.lane_px + 12), GROUND)
    if strip is OVERVIEW:
        _frame_close_up(canvas)


def _frame_close_up(canvas: Canvas) -> None:
    """Draw corners in the overview around the part of the road that the close-up shows."""
    left, right = OVERVIEW.x(-CLOSE_UP.behind_m), OVERVIEW.x(CLOSE_UP.ahead_m)
    upper, lower = OVERVIEW.top - 7.0, OVERVIEW.top + 3.0 * OVERVIEW.lane_px + 7
    for x, inward in ((left, 6), (right, -6)):
        corner: list[Point] = [(x + inward, upper), (x, upper), (x, lower), (x + inward, lower)]
        canvas.line(corner, BRIGHT, 1.5)


def _every(spacing_m: float, ego_s_m: float, road: Road, strip: RoadStrip) -> Iterator[float]:
    """Yield how far ahead, m, the road has its marks in the strip; a loop has whole spacings."""
    pitch_m = road.lap_m / max(1, round(road.lap_m / spacing_m))
    mark_m = -strip.behind_m - (ego_s_m - strip.behind_m) % pitch_m
    while mark_m < strip.ahead_m:
        yield mark_m
        mark_m += pitch_m


def _draw_markings(canvas: Canvas, strip: RoadStrip, ego_s_m: float, road: Road) -> None:
    """Draw the dashes between lanes, and the barricades on closed lanes, fixed to the road."""
    thick = 1.5 if strip is CLOSE_UP else 1.0
    for boundary in range(1, len(road.open_lanes)):
        y = strip.y(road, road.center_m(boundary) - road.lane_width_m / 2)
        for mark_m in _every(12.0, ego_s_m, road, strip):
            if _is_dashed(road, boundary, ego_s_m + mark_m):
                canvas.line([(strip.x(mark_m), y), (strip.x(mark_m + DASH_M), y)], BRIGHT, thick)
    for lane in range(len(road.open_lanes)):
        if not is_open(lane, road):
            _draw_barricade(canvas, strip, ego_s_m, road, lane)


def _is_dashed(road: Road, boundary: int, from_m: float) -> bool:
    """Return whether vehicles may change lanes along the dash to the right of lane ``boundary``."""
    return not road.partial_lanes or any(
        is_open_at(boundary - 1, s_m, road) and is_beside(boundary - 1, boundary, s_m, road)
        for s_m in (from_m, from_m + DASH_M)
    )


def _draw_barricade(
    canvas: Canvas, strip: RoadStrip, ego_s_m: float, road: Road, lane: int
) -> None:
    """Draw stripes and blocks along a barricaded lane."""
    center_m, half_m = road.center_m(lane), road.lane_width_m / 2
    upper, lower = strip.y(road, center_m + 0.9 * half_m), strip.y(road, center_m - 0.9 * half_m)
    slant_m = (lower - upper) / strip.px_per_m
    for mark_m in _every(2.0, ego_s_m, road, strip):
        stripe = [(strip.x(mark_m), lower), (strip.x(mark_m + slant_m), upper)]
        canvas.line(stripe, (124, 84, 52), 2 if strip is CLOSE_UP else 1)
    top, bottom = strip.y(road, center_m + 0.45), strip.y(road, center_m - 0.45)
    for mark_m in _every(6.0, ego_s_m, road, strip):
        left, right = strip.x(mark_m), strip.x(mark_m + 3.6)
        canvas.box((left, top, right, bottom), (176, 178, 176), radius=2)
        canvas.box((left, (top + 2 * bottom) / 3, right, bottom), (120, 122, 122), radius=2)


def _draw_vehicle(
    canvas: Canvas, strip: RoadStrip, snapshot: Snapshot, road: Road, row: int, ahead_m: float
) -> None:
    """Draw the vehicle of a row in its true size, ``ahead_m`` ahead of the ego."""
    y_m, speed = float(snapshot.y_m[row]), float(snapshot.speed_m_s[row])
    length, width = float(snapshot.length_m[row]), float(snapshot.width_m[row])
    left, right = strip.x(ahead_m - length / 2), strip.x(ahead_m + length / 2)
    top, bottom = strip.y(road, y_m + width / 2), strip.y(road, y_m - width / 2)
    is_ego, tall = row == EGO, bottom - top
    fill, outline = (EGO_COLOR, BRIGHT) if is_ego else (speed_color(speed), DARK)
    radius = min(0.28 * tall, 0.28 * (right - left))
    canvas.box((left, top, right, bottom), fill, radius, outline, 2 if is_ego else 1)
    glass = right - 0.27 * (right - left)
    depth = 0.12 * (right - left)
    canvas.box((glass, top + 0.16 * tall, glass + depth, bottom - 0.16 * tall), DARK, 0.3 * depth)
    sideways = float(snapshot.lateral_speed_m_s[row])
    if strip is CLOSE_UP:
        middle = (left + 0.38 * (right - left), (top + bottom) / 2)
        canvas.text(middle, f"{speed:.0f} m/s", 12, BRIGHT if is_ego else DARK, "mm", bold=True)
    if abs(sideways) > _MOVING_SIDEWAYS_M_S:
        _draw_signals(canvas, (left, top, right, bottom), sideways, snapshot.time_s)
        if is_ego and strip is CLOSE_UP:
            _draw_arrow(canvas, (left, top, right, bottom), sideways)


def _draw_signals(
    canvas: Canvas, body: tuple[float, float, float, float], sideways: float, time_s: float
) -> None:
    """Draw turn signals towards ``sideways`` (left positive) in the first half of each second."""
    left, top, right, bottom = body
    if time_s % 1.0 < 0.5:
        size = 0.13 * (bottom - top)
        for x in (left + size, right - size):
            canvas.dot((x, top + size if sideways > 0 else bottom - size), 1.3 * size, AMBER)


def _draw_arrow(canvas: Canvas, body: tuple[float, float, float, float], sideways: float) -> None:
    """Draw an arrow beside the ego in the direction of its lateral velocity, left positive."""
    left, top, right, bottom = body
    up = -1 if sideways > 0 else 1
    x, y = (left + right) / 2, (top if sideways > 0 else bottom) + up * 5
    canvas.line([(x, y), (x, y + up * 10)], AMBER, 4)
    canvas.polygon([(x - 9, y + up * 9), (x + 9, y + up * 9), (x, y + up * 20)], AMBER)
