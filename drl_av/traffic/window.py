"""Controls the window of sumo-gui: it follows the ego, shows a caption and colours the vehicles."""

import math
from collections.abc import Mapping
from typing import Any

from drl_av.traffic.population import EGO_ID

VIEW = "View #0"
WIDTH_M = 200.0
"""Length of road that the window shows."""
ASPECT = 2.38
"""Width by height of the road view in a window of 1280 by 720 pixels, without the toolbars."""
CAPTION = "caption"
CAPTION_SHARE = 0.42
"""Distance of the caption below the ego, as a share of the window's height."""
Color = tuple[int, int, int]


class Window:
    """The window of sumo-gui; the ego is in its middle and always drives to the right.

    The caption is a SUMO point of interest, below the ego and at the right side of its road.
    """

    def __init__(self, sumo: Any) -> None:
        self._sumo = sumo
        (left_m, low_m), (right_m, high_m) = sumo.simulation.getNetBoundary()
        whole_m = max(right_m - left_m, ASPECT * (high_m - low_m))
        sumo.gui.trackVehicle(VIEW, EGO_ID)
        sumo.gui.setZoom(VIEW, 100.0 * whole_m / WIDTH_M)  # at 100 % the whole road fits in
        sumo.poi.add(CAPTION, 0.0, 0.0, (0, 0, 0, 0))
        self.follow()

    def follow(self) -> None:
        """Turn the view and move the caption with the ego; call it after each SUMO step."""
        (_, low_m), (_, high_m) = self._sumo.gui.getBoundary(VIEW)
        below_m = CAPTION_SHARE * (high_m - low_m)
        x_m, y_m = self._sumo.vehicle.getPosition(EGO_ID)
        clockwise_from_north = self._sumo.vehicle.getAngle(EGO_ID)
        heading_rad = math.radians(90.0 - clockwise_from_north)
        right = math.sin(heading_rad), -math.cos(heading_rad)
        self._sumo.gui.setAngle(VIEW, clockwise_from_north - 90.0)
        self._sumo.poi.setPosition(CAPTION, x_m + below_m * right[0], y_m + below_m * right[1])

    def show(self, text: str, colors: Mapping[str, Color]) -> None:
        """Show a line of text as the caption, and colour the vehicles whose ids ``colors`` holds.

        A colour is (red, green, blue), each from 0 to 255.
        """
        self._sumo.poi.setParameter(CAPTION, CAPTION, text)
        for name, color in colors.items():
            self._sumo.vehicle.setColor(name, color)
