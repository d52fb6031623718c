"""Draws the road near the ego as a straight road, in a close-up and in an overview."""

from collections.abc import Iterator

from drl_av.drawing.band import RoadStrip
from drl_av.drawing.canvas import (
    AMBER,
    ASPHALT,
    BARRED,
    BRIGHT,
    DARK,
    DIM,
    EGO_COLOR,
    GROUND,
    SHEET_SIZE,
    Canvas,
    Point,
    speed_color,
)
from drl_av.drawing.partial_lanes import draw_partial_lanes
from drl_av.road.road import Road
from drl_av.road.snapshot import EGO, Snapshot

_MOVING_SIDEWAYS_M_S = 0.05
DASH_M = 5.0
"""Length of a dash between two lanes."""


CLOSE_UP = RoadStrip(top=66, lane_px=60, behind_m=32.0, ahead_m=60.0)
OVERVIEW = RoadStrip(top=276, lane_px=24, behind_m=90.0, ahead_m=150.0)


def lay_marks(sheet: Canvas) -> None:
    """Draw the scale of distances from the ego, below the overview."""
    for mark_m in (-90, -50, 0, 50, 100, 150):
        anchor = {-90: "ls", 150: "rs"}.get(mark_m, "ms")
        text = "ego" if mark_m == 0 else f"{mark_m:+d} m"
        sheet.text((OVERVIEW.x(mark_m), 371), text, 12, DIM, anchor)


def lay_asphalt(sheet: Canvas, band: RoadStrip, road: Road) -> None:
    """Draw the static parts of a band: asphalt, road edges and barricaded lanes."""
    lanes, half = len(road.open_lanes), road.lane_width_m / 2
    verge = band.lane_px / 8
    top = band.y(road, road.center_m(lanes - 1) + half)
    bottom = band.y(road, -half)
    sheet.box((band.left, top - verge, band.right, bottom + verge), ASPHALT)
    for lane in range(lanes):
        if not road.is_open(lane):
            upper, lower = (band.y(road, road.center_m(lane) + side) for side in (half, -half))
            sheet.box((band.left, upper, band.right, lower), BARRED)
    if road.partial_lanes:
        return
    thick = 2 if band is CLOSE_UP else 1.5
    sheet.line([(band.left, top), (band.right, top)], AMBER, thick)
    sheet.line([(band.left, bottom), (band.right, bottom)], BRIGHT, thick)


def draw_band(sheet: Canvas, band: RoadStrip, snapshot: Snapshot, road: Road) -> None:
    """Draw the moving parts of a band: lanes that begin or end, markings, barricades, vehicles."""
    if road.partial_lanes:
        draw_partial_lanes(sheet, band, float(snapshot.s_m[EGO]), road)
    _draw_markings(sheet, band, float(snapshot.s_m[EGO]), road)
    ahead = road.ahead_m(float(snapshot.s_m[EGO]), snapshot.s_m)
    for row in reversed(range(len(snapshot.ids))):
        for lap_m in (-road.lap_m, 0.0, road.lap_m):
            ahead_m = float(ahead[row]) + lap_m
            if -band.behind_m - 10 < ahead_m < band.ahead_m + 10:
                _draw_vehicle(sheet, band, snapshot, road, row, ahead_m)
    edge = SHEET_SIZE[0]
    for left, right in ((0, band.left), (band.right, edge)):
        sheet.box((left, band.top - 12, right, band.top + 3 * band.lane_px + 12), GROUND)
    if band is OVERVIEW:
        _frame_close_up(sheet)


def _frame_close_up(sheet: Canvas) -> None:
    """Draw corners in the overview around the part of the road that the close-up shows."""
    left, right = OVERVIEW.x(-CLOSE_UP.behind_m), OVERVIEW.x(CLOSE_UP.ahead_m)
    upper, lower = OVERVIEW.top - 7.0, OVERVIEW.top + 3.0 * OVERVIEW.lane_px + 7
    for x, inward in ((left, 6), (right, -6)):
        corner: list[Point] = [(x + inward, upper), (x, upper), (x, lower), (x + inward, lower)]
        sheet.line(corner, BRIGHT, 1.5)


def _every(spacing_m: float, ego_s_m: float, road: Road, band: RoadStrip) -> Iterator[float]:
    """Yield how far ahead, m, the road has its marks in the band; a loop has whole spacings."""
    pitch_m = road.lap_m / max(1, round(road.lap_m / spacing_m))
    mark_m = -band.behind_m - (ego_s_m - band.behind_m) % pitch_m
    while mark_m < band.ahead_m:
        yield mark_m
        mark_m += pitch_m


def _draw_markings(sheet: Canvas, band: RoadStrip, ego_s_m: float, road: Road) -> None:
    """Draw the dashes between lanes, and the barricades on closed lanes, fixed to the road."""
    thick = 1.5 if band is CLOSE_UP else 1.0
    for boundary in range(1, len(road.open_lanes)):
        y = band.y(road, road.center_m(boundary) - road.lane_width_m / 2)
        for mark_m in _every(12.0, ego_s_m, road, band):
            if _is_dashed(road, boundary, ego_s_m + mark_m):
                sheet.line([(band.x(mark_m), y), (band.x(mark_m + DASH_M), y)], BRIGHT, thick)
    for lane in range(len(road.open_lanes)):
        if not road.is_open(lane):
            _draw_barricade(sheet, band, ego_s_m, road, lane)


def _is_dashed(road: Road, boundary: int, from_m: float) -> bool:
    """Return whether vehicles may change lanes along the dash to the right of lane ``boundary``."""
    return not road.partial_lanes or any(
        road.is_open_at(boundary - 1, s_m) and road.is_beside(boundary - 1, boundary, s_m)
        for s_m in (from_m, from_m + DASH_M)
    )


def _draw_barricade(sheet: Canvas, band: RoadStrip, ego_s_m: float, road: Road, lane: int) -> None:
    """Draw stripes and blocks along a barricaded lane."""
    center_m, half_m = road.center_m(lane), road.lane_width_m / 2
    upper, lower = band.y(road, center_m + 0.9 * half_m), band.y(road, center_m - 0.9 * half_m)
    slant_m = (lower - upper) / band.px_per_m
    for mark_m in _every(2.0, ego_s_m, road, band):
        stripe = [(band.x(mark_m), lower), (band.x(mark_m + slant_m), upper)]
        sheet.line(stripe, (124, 84, 52), 2 if band is CLOSE_UP else 1)
    top, bottom = band.y(road, center_m + 0.45), band.y(road, center_m - 0.45)
    for mark_m in _every(6.0, ego_s_m, road, band):
        left, right = band.x(mark_m), band.x(mark_m + 3.6)
        sheet.box((left, top, right, bottom), (176, 178, 176), radius=2)
        sheet.box((left, (top + 2 * bottom) / 3, right, bottom), (120, 122, 122), radius=2)


def _draw_vehicle(
    sheet: Canvas, band: RoadStrip, snapshot: Snapshot, road: Road, row: int, ahead_m: float
) -> None:
    """Draw the vehicle of a row in its true size, ``ahead_m`` ahead of the ego."""
    y_m, speed = float(snapshot.y_m[row]), float(snapshot.speed_m_s[row])
    length, width = float(snapshot.length_m[row]), float(snapshot.width_m[row])
    left, right = band.x(ahead_m - length / 2), band.x(ahead_m + length / 2)
    top, bottom = band.y(road, y_m + width / 2), band.y(road, y_m - width / 2)
    is_ego, tall = row == EGO, bottom - top
    fill, outline = (EGO_COLOR, BRIGHT) if is_ego else (speed_color(speed), DARK)
    radius = min(0.28 * tall, 0.28 * (right - left))
    sheet.box((left, top, right, bottom), fill, radius, outline, 2 if is_ego else 1)
    glass = right - 0.27 * (right - left)
    depth = 0.12 * (right - left)
    sheet.box((glass, top + 0.16 * tall, glass + depth, bottom - 0.16 * tall), DARK, 0.3 * depth)
    sideways = float(snapshot.lateral_speed_m_s[row])
    if band is CLOSE_UP:
        middle = (left + 0.38 * (right - left), (top + bottom) / 2)
        sheet.text(middle, f"{speed:.0f} m/s", 12, BRIGHT if is_ego else DARK, "mm", bold=True)
    if abs(sideways) > _MOVING_SIDEWAYS_M_S:
        _draw_signals(sheet, (left, top, right, bottom), sideways, snapshot.time_s)
        if is_ego and band is CLOSE_UP:
            _draw_arrow(sheet, (left, top, right, bottom), sideways)


def _draw_signals(
    sheet: Canvas, body: tuple[float, float, float, float], sideways: float, time_s: float
) -> None:
    """Draw turn signals towards ``sideways`` (left positive) in the first half of each second."""
    left, top, right, bottom = body
    if time_s % 1.0 < 0.5:
        size = 0.13 * (bottom - top)
        for x in (left + size, right - size):
            sheet.dot((x, top + size if sideways > 0 else bottom - size), 1.3 * size, AMBER)


def _draw_arrow(sheet: Canvas, body: tuple[float, float, float, float], sideways: float) -> None:
    """Draw an arrow beside the ego in the direction of its lateral velocity, left positive."""
    left, top, right, bottom = body
    up = -1 if sideways > 0 else 1
    x, y = (left + right) / 2, (top if sideways > 0 else bottom) + up * 5
    sheet.line([(x, y), (x, y + up * 10)], AMBER, 4)
    sheet.polygon([(x - 9, y + up * 9), (x + 9, y + up * 9), (x, y + up * 20)], AMBER)
