"""A section of road around the ego, drawn as a straight band."""

from dataclasses import dataclass

from drl_av.road.road import Road


@dataclass(frozen=True)
class RoadStrip:
    """A view of the road around the ego as a horizontal band; traffic drives to the right."""

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
