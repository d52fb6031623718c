"""Writes one or two episodes as an HTML file that a browser plays without a network connection."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drl_av.drawing.canvas import EGO_COLOR, FAST_M_S, SLOW_M_S, SPEED_COLORS
from drl_av.driving.actions import ACTIONS
from drl_av.files.atomic import write_atomic
from drl_av.road.road import OPEN_LAP_M, PartialLane, Road
from drl_av.road.snapshot import Snapshot

TEMPLATE = Path(__file__).with_name("page.html")
PLACEHOLDER = "EPISODE"
"""The text in the template that the episode's data replace."""


@dataclass
class PageEpisode:
    """An episode to show."""

    title: str
    facts: str = ""
    """A line beside the title."""
    values_are: str = "Q-values"
    """What the values of the decisions are, in words."""
    snapshots: list[Snapshot] = field(default_factory=list)
    """The scene at the start and after each decision: one more than there are decisions."""
    decisions: list[dict[str, Any]] = field(default_factory=list)
    """The data of each decision: ``proposed`` and ``executed``, numbers of actions before and after
    the safety check; ``rule``, the rules that changed the action, or ``none``; ``reward``, and its
    terms ``r_v``, ``r_y`` and ``r_x``, which rate the ego's speed, lane and gap; ``values``, the
    driver's of the 12 actions, or None; ``changes_lane``, whether a lane change of the ego begins;
    and ``collision``, the kind of its collision in words, or None."""


def write_page(path: Path, road: Road, episodes: Sequence[PageEpisode]) -> None:
    """Write an HTML page of episodes on the same road, with one time bar, to ``path`` atomically.

    Raises:
        DrlAvError: the file cannot be written.
    """
    page = {
        "road": {
            "circumference_m": road.lap_m,
            "end_m": None if road.is_loop else road.end_m,
            "lane_width_m": road.lane_width_m,
            "open_lanes": road.open_lanes,
            "partial_lanes": [_part(part, road) for part in road.partial_lanes],
        },
        "actions": [str(action) for action in ACTIONS],
        "colors": {
            "ego": EGO_COLOR,
            "speed": SPEED_COLORS.tolist(),
            "slow_m_s": SLOW_M_S,
            "fast_m_s": FAST_M_S,
        },
        "episodes": [_episode(episode) for episode in episodes],
    }
    data = json.dumps(page, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    template = TEMPLATE.read_text(encoding="utf-8")
    write_atomic(path, template.replace(PLACEHOLDER, data, 1).encode())


def _episode(episode: PageEpisode) -> dict[str, Any]:
    shots = episode.snapshots
    sizes = _sizes(shots)
    return vars(episode) | {
        "times": [round(shot.time_s - shots[0].time_s, 3) for shot in shots],
        "sizes": [*sizes.values()],
        "frames": [_frame(snapshot, [*sizes]) for snapshot in shots],
        "snapshots": None,
    }


def _part(part: PartialLane, road: Road) -> dict[str, float]:
    """Return the data of a partial lane, whose ends are finite, because JSON has no infinity."""
    beyond_m = road.end_m + OPEN_LAP_M / 4
    ends = {"end_m": min(part.end_m, beyond_m), "joined_to_m": min(part.joined_to_m, beyond_m)}
    return part._asdict() | ends


def _sizes(snapshots: Sequence[Snapshot]) -> dict[str, tuple[float, float]]:
    """Return the length and width of each vehicle of an episode, m, by name, the ego first."""
    sizes: dict[str, tuple[float, float]] = {}
    for shot in snapshots:
        length, width = _rounded(shot.length_m, shot.width_m)
        sizes |= dict(zip(shot.ids, zip(length, width, strict=True), strict=True))
    return sizes


def _frame(snapshot: Snapshot, names: Sequence[str]) -> dict[str, list[float | None]]:
    """Return position and speed of each named vehicle; None while it is not on the road."""
    columns = _rounded(snapshot.s_m, snapshot.y_m, snapshot.speed_m_s)
    found = {}
    for key, column in zip("syv", columns, strict=True):
        values = dict(zip(snapshot.ids, column, strict=True))
        found[key] = [values.get(name) for name in names]
    return found


def _rounded(*columns: Any) -> list[list[float]]:
    """Return each array as a list of numbers with two decimals, which keeps the file small."""
    return [[round(float(value), 2) for value in column] for column in columns]
