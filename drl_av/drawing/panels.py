"""Draws the panels beside the road: driver, decision, safety check, reward and history."""

from dataclasses import dataclass

import numpy as np

from drl_av.drawing.canvas import (
    ALARM,
    AMBER,
    BRIGHT,
    CARD,
    DARK,
    DIM,
    EGO_COLOR,
    FAST_M_S,
    GROUND,
    RULE,
    SLOW_M_S,
    Canvas,
    Color,
    speed_color,
    wrapped,
)
from drl_av.errors import pluralize
from drl_av.road.snapshot import EGO, Snapshot

_HISTORY = 60


@dataclass(frozen=True)
class Caption:
    """The contents of the panels; the defaults describe a scene after a reset.

    ``r_v``, ``r_y`` and ``r_x`` are the terms of the reward for the ego's speed, lane and gap.
    """

    driver: str = ""
    vehicles: int | None = None
    """Number of vehicles besides the ego; None to count those of the snapshot."""
    seed: int | None = None
    decision: int = 0
    proposed: str = ""
    executed: str = ""
    rule: str | None = None
    """The name of the safety rule that changed the action; None if no rule changed it."""
    reward: float | None = None
    r_v: float | None = None
    r_y: float | None = None
    r_x: float | None = None
    speed_history: tuple[float, ...] = ()
    """The ego's speed after each decision, m/s; the panel shows the last 60 and the mean of all."""
    trigger_history: tuple[bool, ...] = ()
    """Whether the safety check changed the action, for each decision of ``speed_history``."""
    collision: str = ""
    """The kind of the ego's collision in words; empty without a collision."""
    lane_change: str = ""
    """The side and the finished share of a lane change in progress; empty without one."""


def lay_cards(canvas: Canvas) -> None:
    """Draw the backgrounds of the panels."""
    left, middle, right = (20, 352), (364, 812), (824, 1260)
    for (x0, x1), (y0, y1) in (
        (left, (384, 708)),
        (middle, (384, 708)),
        (right, (384, 536)),
        (right, (548, 708)),
    ):
        canvas.box((x0, y0, x1, y1), CARD, radius=12)


def lay_legend(canvas: Canvas) -> None:
    """Draw the legend of the vehicles' colours."""
    left, right = 1040, 1211
    for x in range(left, right):
        share = (x - left) / (right - left)
        canvas.box((x, 20, x + 1, 32), speed_color(SLOW_M_S + share * (FAST_M_S - SLOW_M_S)))
    canvas.text((left - 8, 31), f"{SLOW_M_S:g} m/s", 14, DIM, "rs")
    canvas.text((right + 8, 31), f"{FAST_M_S:g} m/s", 14, DIM)
    canvas.box((921, 19, 947, 33), EGO_COLOR, radius=4, outline=BRIGHT, width=1.5)
    canvas.text((953, 31), "ego", 14, DIM)


def draw_header(canvas: Canvas, snapshot: Snapshot, caption: Caption) -> None:
    """Draw the driver, the traffic, the seed, the decision and the time above the road."""
    vehicles = len(snapshot.ids) - 1 if caption.vehicles is None else caption.vehicles
    facts = [pluralize(vehicles, "vehicle")]
    facts += [] if caption.seed is None else [f"seed {caption.seed}"]
    facts += [f"decision {caption.decision}", f"t = {snapshot.time_s:.1f} s"]
    canvas.text((20, 36), wrapped(caption.driver or "highway", 24, 400, 1)[0], 24, bold=True)
    canvas.text((890, 33), "   ".join(facts), 16, DIM, "rs")


def draw_decision(canvas: Canvas, snapshot: Snapshot, caption: Caption) -> None:
    """Draw the speed, the executed and the proposed action, and the result of the safety check."""
    speed = float(snapshot.speed_m_s[EGO])
    mean = float(np.mean(caption.speed_history)) if caption.speed_history else speed
    canvas.text((384, 410), "SPEED", 13, DIM)
    canvas.text((384, 464), f"{speed:.1f}", 58, bold=True)
    canvas.text((512, 464), "m/s", 20, DIM)
    canvas.text((792, 410), "MEAN SO FAR", 13, DIM, "rs")
    canvas.text((792, 464), f"{mean:.1f} m/s", 28, BRIGHT, "rs")
    canvas.line([(384, 484), (792, 484)], RULE, 1)
    overruled = bool(caption.proposed) and caption.proposed != caption.executed
    _draw_field(canvas, 508, "EXECUTED", caption.executed or "-", BRIGHT)
    canvas.text((792, 508), caption.lane_change, 16, AMBER, "rs")
    proposal = caption.proposed if overruled else "as executed" if caption.executed else "-"
    _draw_field(canvas, 560, "PROPOSED", proposal, ALARM if overruled else DIM)
    _draw_verdict(canvas, caption)


def _draw_field(canvas: Canvas, y: float, label: str, value: str, fill: Color) -> None:
    """Draw a label and, below it, a value; ``y`` is the baseline of the label, px."""
    canvas.text((384, y), label, 13, DIM)
    canvas.text((384, y + 26), wrapped(value, 22, 408, 1)[0], 22, fill)


def _draw_verdict(canvas: Canvas, caption: Caption) -> None:
    """Draw the safety rule or the collision on a bright background, or that neither happened."""
    label, words = "SAFETY CHECK", caption.rule or "changes nothing"
    if caption.collision:
        label, words = "COLLISION", caption.collision
    alarmed = bool(caption.rule or caption.collision)
    ink = DARK if alarmed else DIM
    fill = EGO_COLOR if caption.collision else ALARM if alarmed else GROUND
    canvas.box((376, 606, 800, 696), fill, radius=9)
    canvas.text((392, 627), label, 13, ink, bold=alarmed)
    lines, size, pitch = wrapped(words, 19, 392, 3), 19, 26
    if len(lines) > 2:
        lines, size, pitch = wrapped(words, 16, 392, 3), 16, 19
    for number, line in enumerate(lines):
        canvas.text((392, 634 + pitch * (number + 0.8)), line, size, ink)


def draw_reward(canvas: Canvas, caption: Caption) -> None:
    """Draw the reward, and its three terms as bars from -1 at the left to 0 at the right."""
    canvas.text((844, 412), "REWARD", 13, DIM)
    canvas.text((1240, 416), _number(caption.reward), 24, BRIGHT, "rs", bold=True)
    terms = (("speed", caption.r_v), ("lane", caption.r_y), ("gap", caption.r_x))
    left, right = 900, 1176
    for number, (label, value) in enumerate(terms):
        y = 446 + 28 * number
        canvas.text((844, y), label, 16, DIM, "lm")
        canvas.box((left, y - 7, right, y + 7), GROUND, radius=3)
        share = min(1.0, max(0.0, -(value or 0.0)))
        if share > 0:
            corners = (right - share * (right - left), y - 7, right, y + 7)
            canvas.box(corners, ALARM if share > 0.5 else AMBER, radius=3)
        canvas.text((1240, y), _number(value), 16, BRIGHT, "rm")
    canvas.text((left, 529), "-1", 12, DIM)
    canvas.text((right, 529), "0", 12, DIM, "rs")


def _number(value: float | None) -> str:
    """Return a number as text with two decimals; "-" for None."""
    return "-" if value is None else f"{value:z.2f}"


def draw_history(canvas: Canvas, caption: Caption) -> None:
    """Draw the last 60 speeds, the newest at the right.

    A red mark shows a decision in which the safety check changed the action.
    """
    left, right, top, bottom = 878.0, 1240.0, 588.0, 680.0
    canvas.text((844, 574), f"SPEED, m/s, LAST {_HISTORY} DECISIONS", 13, DIM)
    canvas.box((1161, 563, 1164, 577), ALARM)
    canvas.text((1240, 574), "check fired", 13, DIM, "rs")
    speeds = caption.speed_history[-_HISTORY:]
    most = max(40.0, *speeds) if speeds else 40.0
    for mark in (0.0, 20.0, 40.0):
        y = bottom - (bottom - top) * mark / most
        canvas.line([(left, y), (right, y)], RULE, 1)
        canvas.text((left - 8, y), f"{mark:g}", 12, DIM, "rm")
    step = (right - left) / (_HISTORY - 1)
    columns = [right - step * age for age in reversed(range(len(speeds)))]
    points = [(x, bottom - (bottom - top) * v / most) for x, v in zip(columns, speeds, strict=True)]
    if points:
        canvas.line(points, EGO_COLOR, 2.5)
        canvas.dot(points[-1], 4, EGO_COLOR)
    fired = caption.trigger_history[-_HISTORY:]
    for age, hit in enumerate(reversed(fired)):
        if hit:
            x = right - step * age
            canvas.box((x - 1.5, bottom + 5, x + 1.5, bottom + 18), ALARM)
