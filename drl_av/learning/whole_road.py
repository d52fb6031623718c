"""What the critic of a training at scale sees besides the driver's observation (ours).

An actor that is to drive sees only what a driver sees; the critic, which only the training needs,
may know more, and its values vary less (Pinto et al. 2018, Asymmetric actor critic).
"""

import numpy as np
import numpy.typing as npt

from drl_av.compiled import compiled
from drl_av.road.compiled_road import RoadNumbers, ahead_m, lane_of
from drl_av.twin.worlds import DESIRED_M_S, FloatArray, IntArray

PLACES_M = np.array([-100.0, 0.0, 40.0, 80.0, 130.0, 200.0, 300.0, 450.0])
"""Between these distances ahead of the ego, and beyond them, the vehicles of each lane count."""
OF_A_PLACE = 3
"""Per lane and place: the vehicles, divided by 5, and the sums of their speeds and of their desired
speeds, each speed as (speed - 20 m/s) / 30 m/s."""


def whole_road_size(lanes: int) -> int:
    """Return how many numbers describe the vehicles of a road."""
    return lanes * (len(PLACES_M) + 1) * OF_A_PLACE


@compiled
def look_at_whole_road(
    scene: FloatArray,
    x: FloatArray,
    count: IntArray,
    road: RoadNumbers,
    places_m: FloatArray,
    rows: IntArray,
    seen: npt.NDArray[np.float32],
) -> None:
    """Fill ``seen[rows]``, shape (worlds, whole_road_size), with all vehicles but the ego.

    ``scene`` is that of ``Episodes``, ``x`` that of ``Worlds``; ``count``, shape (worlds,), holds
    the numbers of vehicles, the ego included. ``places_m`` is ``PLACES_M``.
    """
    lanes, places = len(road.open_lanes), len(places_m) + 1
    for w in rows:
        seen[w, : lanes * places * OF_A_PLACE] = 0.0
        for row in range(1, count[w]):
            away_m = ahead_m(scene[w, 0, 0], scene[w, 0, row], road.lap_m)
            place = 0
            while place < places - 1 and away_m >= places_m[place]:
                place += 1
            lane = min(max(lane_of(scene[w, 1, row], road.lane_width_m), 0), lanes - 1)
            at = (lane * places + place) * OF_A_PLACE
            seen[w, at] += 0.2
            seen[w, at + 1] += (scene[w, 2, row] - 20.0) / 30.0
            seen[w, at + 2] += (x[w, DESIRED_M_S, row] - 20.0) / 30.0
