"""Reads the state of SUMO's vehicles, in the coordinates of a snapshot."""

from collections.abc import Sequence
from types import ModuleType

from drl_av.traffic.connection import getters
from drl_av.traffic.road import FloatArray
from drl_av.traffic.scenario import Scenario

STATE = (
    *("getLaneID", "getLanePosition", "getLateralLanePosition", "getSpeed", "getLateralSpeed"),
    "getLaneChangeState",
)


class Readings:
    """Reads the state of the vehicles on the road; ``watch`` sets their names."""

    _ids: Sequence[str]
    _half_m: list[float]

    def __init__(self, sumo: ModuleType, scenario: Scenario) -> None:
        self._lane_positions = scenario.layout.lane_positions
        self._lap_m, self._lane_m = scenario.road.lap_m, scenario.road.lane_width_m
        self._lane, self._at, self._aside, self._speed, *others = getters(sumo, STATE)
        self._lateral_speed, self._lane_change = others
        bits = sumo.constants
        self._wanted = (1, bits.LCA_LEFT), (-1, bits.LCA_RIGHT)
        self._blocked: int = bits.LCA_BLOCKED

    def watch(self, ids: Sequence[str], length_m: FloatArray) -> None:
        """Set the vehicles on the road; a row is an index into ``ids``, the ego's is 0."""
        self._ids, self._half_m = ids, (length_m / 2).tolist()

    def place(self, row: int) -> tuple[float, float]:
        """Return the position of a vehicle's centre along (s) and across (y) the road, metres."""
        name = self._ids[row]
        lane, start_m = self._lane_positions[self._lane(name)]
        along_m = (start_m + self._at(name) - self._half_m[row]) % self._lap_m
        return along_m, lane * self._lane_m + self._aside(name)

    def state(self, first: int = 0) -> tuple[list[float], ...]:
        """Return lists of s, y (m), speed and lateral speed (m/s) of the rows from ``first`` on."""
        ids, lap_m, lane_m = self._ids[first:], self._lap_m, self._lane_m
        at_m, aside_m = [*map(self._at, ids)], [*map(self._aside, ids)]
        speed, lateral = [*map(self._speed, ids)], [*map(self._lateral_speed, ids)]
        along_m, across_m = [], []
        found = map(self._lane_positions.__getitem__, map(self._lane, ids))
        rows = zip(found, at_m, aside_m, self._half_m[first:], strict=True)
        for (lane, start_m), at, aside, half_m in rows:
            along_m.append((start_m + at - half_m) % lap_m)
            across_m.append(lane * lane_m + aside)
        return along_m, across_m, speed, lateral

    def lane_change(self, row: int) -> int:
        """Return the lane change that SUMO's model would make now: +1 left, -1 right, 0 none."""
        for sign, wanted in self._wanted:
            state = self._lane_change(self._ids[row], sign)[0]
            if state & wanted and not state & self._blocked:
                return sign
        return 0
