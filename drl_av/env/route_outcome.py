"""How the ego's route ends: whether it takes its exit, or leaves the lane that ends."""

import math

from drl_av.driving.affordances import FRONT, LANE, Indicators
from drl_av.road.road import Road, lane_end_m, mandatory_change

EXIT_TAKEN, EXIT_MISSED = "exit taken", "exit missed"
MERGED, NOT_MERGED = "merged", "not merged"
COMPLETE = (EXIT_TAKEN, MERGED)
"""The outcomes of a route that the ego has completed."""


class RouteOutcome:
    """The outcome of the ego's route in one episode.

    The route leads to the ego's exit. On a road without an exit, it leads out of the lane in which
    the ego starts, if that lane ends. Otherwise the ego has no route, and the outcome is always "".
    """

    def __init__(self, road: Road, start: Indicators) -> None:
        self._road, self._has_exit = road, road.exit_m < math.inf
        self._end_m, self._exit_lane = road.exit_m, road.exit_lane
        lane, front_m = place_of(start)
        if not self._has_exit and mandatory_change(lane, front_m, road)[0] != 0:
            self._end_m = lane_end_m(lane, front_m, road)
        self.reached = ""
        """The outcome, or "" while it is not decided."""

    def outcome(self, now: Indicators, over: bool) -> str:
        """Return the outcome of the route after a decision, or "" while it is not decided.

        The outcome is "exit taken" or "exit missed" on a road with an exit, otherwise "merged" or
        "not merged". It stays the same once it is decided. ``over`` says whether the episode ends
        with ``now``, by a collision or otherwise. If the outcome is still open then, it becomes
        "exit missed" or "not merged".
        """
        if self._end_m < math.inf and not self.reached:
            failed = EXIT_MISSED if self._has_exit else NOT_MERGED
            self.reached = self._passed(*place_of(now)) or failed * over
        return self.reached

    def misses_exit(self, now: Indicators) -> bool:
        """Return whether the ego has passed its exit without taking it."""
        return self._has_exit and self._road.misses_exit(*place_of(now))

    def _passed(self, lane: int, front_m: float) -> str:
        """Return the outcome that follows from the ego's place alone; "" if none does."""
        if front_m < self._end_m:
            return ""
        if not self._has_exit:
            return MERGED
        return EXIT_TAKEN if lane <= self._exit_lane else EXIT_MISSED


def place_of(found: Indicators) -> tuple[int, float]:
    """Return the ego's lane, and the position of its front bumper along the road, m."""
    return int(found.codes[LANE]), float(found.values[FRONT])
