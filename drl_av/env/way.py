"""The outcome of the ego's way in an episode: whether it takes its exit, or merges."""

import math

from drl_av.driving.scene import Scene
from drl_av.traffic.road import Road
from drl_av.traffic.snapshot import EGO

EXIT_TAKEN, EXIT_MISSED = "exit taken", "exit missed"
MERGED, NOT_MERGED = "merged", "not merged"
COMPLETE = (EXIT_TAKEN, MERGED)
"""The outcomes of a way that the ego has completed."""


class Way:
    """The way of the ego in one episode.

    It leads to the ego's exit; on a road without one, out of the lane in which the ego starts, if
    that lane ends. Elsewhere the ego has no way, and the outcome is always "".
    """

    def __init__(self, road: Road, start: Scene) -> None:
        self._road = road
        self._merge_m = math.inf
        if start.affordances.mandatory.lanes != 0:
            self._merge_m = road.lane_end_m(start.affordances.lane, front_m(start))
        self._leads_somewhere = min(road.exit_m, self._merge_m) < math.inf
        self._outcome = ""

    def outcome(self, scene: Scene, over: bool) -> str:
        """Return one of the four outcomes after a decision; "" while the way is open.

        ``over`` is whether the episode ends with ``scene``, by a collision or otherwise. The ego
        has then missed its exit or not merged if it had not done so before.
        """
        if self._leads_somewhere and not self._outcome:
            failed = EXIT_MISSED if self._road.exit_m < math.inf else NOT_MERGED
            self._outcome = self._passed(scene) or failed * over
        return self._outcome

    def _passed(self, scene: Scene) -> str:
        """Return the outcome by the place of the ego alone."""
        at_m = front_m(scene)
        if self._road.exit_m == math.inf:
            return MERGED * (at_m >= self._merge_m)
        found = self._road.exit_outcome(scene.affordances.lane, at_m)
        return {"taken": EXIT_TAKEN, "missed": EXIT_MISSED, "": ""}[found]


def front_m(scene: Scene) -> float:
    """Return the position of the ego's front bumper along the road, metres."""
    snapshot = scene.snapshot
    return float(snapshot.s_m[EGO] + snapshot.length_m[EGO] / 2)
