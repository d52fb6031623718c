"""Controls the window of sumo-gui: it follows the ego, shows a caption and colours the vehicles."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.road.road import is_partial
from drl_av.road.snapshot import EGO_ID
from drl_av.scenarios.layout import Layout

VIEW = "View #0"
AHEAD_M, BEHIND_M = 200.0, 50.0
"""Lengths of the road that the window shows ahead of the ego and behind it."""
BESIDE_M = 9.0
"""Smallest distance between the shown road and the edge of the window."""
CAPTION = "caption"
CAPTION_SHARE = 0.12
"""Share of the view's height, at its lower edge, that is left for the caption."""
Color = tuple[int, int, int]


class GuiCamera:
    """The window of sumo-gui, which is turned so that the ego always drives to the right.

    It shows at least the road from ``BEHIND_M`` behind the ego to ``AHEAD_M`` ahead of it, and the
    shown width never decreases within an episode. The caption is a SUMO point of interest below
    that road. sumo-gui draws only the edges that would be visible if the window were not turned. On
    loops of more than about 600 m, the road may therefore end less than ``AHEAD_M`` ahead.
    """

    def __init__(self, sumo: Any, layout: Layout) -> None:
        self._sumo, self._lane_positions = sumo, layout.lane_positions
        self._center = _center_line(sumo, layout)
        self._road, self._width_m = layout.road, AHEAD_M + BEHIND_M + 2 * BESIDE_M
        sumo.poi.add(CAPTION, 0.0, 0.0, (0, 0, 0, 0))
        self.follow()

    def follow(self) -> None:
        """Turn and move the view, and the caption with it; call it after each SUMO step."""
        gui, vehicle = self._sumo.gui, self._sumo.vehicle
        ego = np.array(vehicle.getPosition(EGO_ID))
        clockwise_from_north = vehicle.getAngle(EGO_ID)
        heading_rad = math.radians(90.0 - clockwise_from_north)
        forward = np.array([math.cos(heading_rad), math.sin(heading_rad)])
        axes = np.array([forward, [-forward[1], forward[0]]])  # forward, and to the left
        seen = (np.vstack([self._road_around_ego(), ego]) - ego) @ axes.T
        (rear_m, right_m), (front_m, left_m) = seen.min(0) - BESIDE_M, seen.max(0) + BESIDE_M
        shown_m, shown_height_m = np.diff(gui.getBoundary(VIEW), axis=0)[0]
        aspect = shown_m / shown_height_m
        enough_m = aspect * (left_m - right_m) / (1 - CAPTION_SHARE)
        self._width_m = max(self._width_m, front_m - rear_m, enough_m)
        height_m = self._width_m / aspect
        middle = (rear_m + front_m) / 2, (right_m + left_m - CAPTION_SHARE * height_m) / 2
        caption = middle[0], middle[1] - (1 - CAPTION_SHARE) / 2 * height_m
        gui.setAngle(VIEW, clockwise_from_north - 90.0)
        gui.setZoom(VIEW, gui.getZoom(VIEW) * shown_m / self._width_m)
        gui.setOffset(VIEW, *(ego + middle @ axes))
        self._sumo.poi.setPosition(CAPTION, *(ego + caption @ axes))

    def show(self, text: str, colors: Mapping[str, Color]) -> None:
        """Show a line of text as the caption, and colour the vehicles whose ids ``colors`` holds.

        A colour is (red, green, blue), each from 0 to 255.
        """
        self._sumo.poi.setParameter(CAPTION, CAPTION, text)
        for name, color in colors.items():
            self._sumo.vehicle.setColor(name, color)

    def _road_around_ego(self) -> FloatArray:
        """Return points of the road around the ego in SUMO's coordinates, shape (points, 2)."""
        _, start_m = self._lane_positions[self._sumo.vehicle.getLaneID(EGO_ID)]
        ego_m = start_m + self._sumo.vehicle.getLanePosition(EGO_ID)
        at_m, x_m, y_m = self._center
        wanted_m = ego_m + np.linspace(-BEHIND_M, AHEAD_M, 11)
        wanted_m = wanted_m % self._road.lap_m if self._road.is_loop else wanted_m
        return np.column_stack([np.interp(wanted_m, at_m, x) for x in (x_m, y_m)])


def _center_line(sumo: Any, layout: Layout) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions along the road, with x and y of a lane that extends along all of it."""
    lanes = range(len(layout.road.open_lanes))
    whole = next(lane for lane in lanes if not is_partial(lane, layout.road))
    at_m, points = [], []
    for name, (lane, start_m) in layout.lane_positions.items():
        if lane == whole:
            shape = np.array(sumo.lane.getShape(name))
            steps = np.hypot(*np.diff(shape, axis=0).T)
            share = np.append(0.0, steps.cumsum() / steps.sum())
            at_m.append(start_m + share * sumo.lane.getLength(name))
            points.append(shape)
    order = np.argsort(np.concatenate(at_m), kind="stable")
    x_m, y_m = np.concatenate(points)[order].T
    return np.concatenate(at_m)[order], x_m, y_m
