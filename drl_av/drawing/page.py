"""An episode as one HTML file that plays in a browser, without an installation or a network."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drl_av.drawing.sheet import EGO_COLOR, FAST_M_S, SLOW_M_S, SPEED_COLORS
from drl_av.driving.actions import ACTIONS
from drl_av.files import write_whole
from drl_av.traffic.road import Road
from drl_av.traffic.snapshot import Snapshot

TEMPLATE = Path(__file__).with_name("page.html")
PLACE = "EPISODE"
"""The text in the template that the episode's data replaces."""


@dataclass(frozen=True)
class PageDecision:
    """One decision in the data of the page."""

    proposed: int
    """Number of the proposed action, 0 to 11."""
    executed: int
    rule: str
    """The rules of the safety check that changed the action, or ``none``."""
    reward: float
    r_v: float
    r_y: float
    r_x: float
    q: list[float] | None
    """The driver's Q-value of each of the 12 actions; None for a driver without Q-values."""
    collision: str | None
    """The collision of the ego in words, or None."""


def write_page(
    path: Path,
    title: str,
    road: Road,
    snapshots: Sequence[Snapshot],
    decisions: Sequence[PageDecision],
) -> None:
    """Write the page of an episode completely or not at all.

    ``snapshots`` contains the start of the episode and the scene after each decision.

    Raises:
        DrlAvError: the file cannot be written.
    """
    episode = {
        "title": title,
        "road": {
            "circumference_m": road.lap_m,
            "lane_width_m": road.lane_width_m,
            "open_lanes": road.open_lanes,
        },
        "actions": [str(action) for action in ACTIONS],
        "colors": {
            "ego": EGO_COLOR,
            "speed": SPEED_COLORS.tolist(),
            "slow_m_s": SLOW_M_S,
            "fast_m_s": FAST_M_S,
        },
        "sizes": list(zip(*_rounded(snapshots[0].length_m, snapshots[0].width_m), strict=True)),
        "frames": [_frame(snapshot) for snapshot in snapshots],
        "decisions": [vars(decision) for decision in decisions],
    }
    data = json.dumps(episode, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    template = TEMPLATE.read_text(encoding="utf-8")
    write_whole(path, template.replace(PLACE, data, 1).encode())


def _frame(snapshot: Snapshot) -> dict[str, list[float]]:
    s, y, v = _rounded(snapshot.s_m, snapshot.y_m, snapshot.speed_m_s)
    return {"s": s, "y": y, "v": v}


def _rounded(*columns: Any) -> list[list[float]]:
    """The columns rounded to two decimals, to keep the file small."""
    return [[round(float(value), 2) for value in column] for column in columns]
