"""The outcome of the ego's route in an episode: whether it takes its exit, or merges."""

import math

from drl_av.driving.scene import Scene
from drl_av.road.road import Road
from drl_av.road.snapshot import EGO

EXIT_TAKEN, EXIT_MISSED = "exit taken", "exit missed"
MERGED, NOT_MERGED = "merged", "not merged"
COMPLETE = (EXIT_TAKEN, MERGED)
"""The outcomes of a route that the ego has completed."""


class RouteOutcome:
    """The outcome of the ego's route in one episode.

    The route leads to the ego's exit. On a road without an exit, it leads out of the lane in which
    the ego starts, if that lane ends. Otherwise the ego has no route, and the outcome is always "".
    """

    def __init__(self, road: Road, start: Scene) -> None:
        self._road, self._has_exit = road, road.exit_m < math.inf
        self._end_m, self._exit_lane = road.exit_m, road.exit_lane
        if not self._has_exit and start.affordances.mandatory.lanes != 0:
            self._end_m = road.lane_end_m(start.affordances.lane, front_m(start))
        self._outcome = ""

    def outcome(self, scene: Scene, over: bool) -> str:
        """Return the outcome of the route after a decision, or "" while it is not decided.

        The outcome is "exit taken" or "exit missed" on a road with an exit, otherwise "merged" or
        "not merged". It stays the same once it is decided. ``over`` says whether the episode ends
        with ``scene``, by a collision or otherwise. If the outcome is still open then, it becomes
        "exit missed" or "not merged".
        """
        if self._end_m < math.inf and not self._outcome:
            failed = EXIT_MISSED if self._has_exit else NOT_MERGED
            self._outcome = self._passed(scene) or failed * over
        return self._outcome

    def misses_exit(self, scene: Scene) -> bool:
        """Return whether the ego has passed its exit without taking it."""
        return self._has_exit and self._road.misses_exit(scene.affordances.lane, front_m(scene))

    def _passed(self, scene: Scene) -> str:
        """Return the outcome that follows from the ego's position alone; "" if none does."""
        if front_m(scene) < self._end_m:
            return ""
        if not self._has_exit:
            return MERGED
        return EXIT_TAKEN if scene.affordances.lane <= self._exit_lane else EXIT_MISSED


def front_m(scene: Scene) -> float:
    """Return the position of the ego's front bumper along the road, m."""
    snapshot = scene.snapshot
    return float(snapshot.s_m[EGO] + snapshot.length_m[EGO] / 2)
