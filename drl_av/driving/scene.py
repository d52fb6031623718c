"""The scene, the input of a decision: all vehicles, the indicators, the lane change in progress."""

from typing import Any, NamedTuple

from drl_av.driving.affordances import Affordances, Indicators, affordances_of
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot


class LaneChange(NamedTuple):
    """A lane change in progress; ``origin`` and ``target`` are lane indices, 0 is the rightmost.

    Its progress follows from the ego's lateral position alone. An abort exchanges ``origin`` and
    ``target``; the ego then needs as much time to return as it has needed so far.
    """

    origin: int
    target: int
    heading_rad: float = 0.0
    """Angle between the ego and its lane, atan(v_y / v_x), left positive; steering plant only."""

    @property
    def sign(self) -> int:
        """Direction of the lane change: +1 left, -1 right."""
        return 1 if self.target > self.origin else -1

    def reversed(self) -> "LaneChange":
        """Return the lane change back to the lane where this one started."""
        return LaneChange(self.target, self.origin, self.heading_rad)


class Scene:
    """All information that a driver or a safety check may use for a decision.

    ``lane_change`` is the ego's lane change in progress, or None. The indicators exist in two
    forms, by name and as arrays; each is computed from the other when it is needed first.
    """

    __slots__ = ("_affordances", "_indicators", "_road", "lane_change", "snapshot")
    _road: Road

    def __init__(
        self, snapshot: Snapshot, affordances: Affordances, lane_change: LaneChange | None
    ) -> None:
        self.snapshot, self.lane_change = snapshot, lane_change
        self._affordances: Affordances | None = affordances
        self._indicators: Indicators | None = None

    @classmethod
    def of(
        cls,
        snapshot: Snapshot,
        indicators: Indicators,
        lane_change: LaneChange | None,
        road: Road,
    ) -> "Scene":
        """Return the scene on ``road`` whose indicators are known as arrays."""
        scene = cls.__new__(cls)
        scene.snapshot, scene.lane_change = snapshot, lane_change
        scene._affordances, scene._indicators, scene._road = None, indicators, road
        return scene

    @property
    def affordances(self) -> Affordances:
        """The indicators by name."""
        if self._affordances is None:
            assert self._indicators is not None
            self._affordances = affordances_of(self._indicators, self._road)
        return self._affordances

    @property
    def indicators(self) -> Indicators:
        """The indicators as arrays, for compiled functions."""
        if self._indicators is None:
            assert self._affordances is not None
            self._indicators = self._affordances.arrays()
        return self._indicators

    @property
    def lanes(self) -> tuple[int, int]:
        """The two lanes of the lane change in progress, equal if there is none."""
        change = self.lane_change
        return (0, 0) if change is None else (change.origin, change.target)

    def _replace(self, **changes: Any) -> "Scene":
        """Return this scene with other values of some of its three fields."""
        given = {
            "snapshot": self.snapshot,
            "affordances": self.affordances,
            "lane_change": self.lane_change,
        }
        return Scene(**(given | changes))

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene, (self.snapshot, self.affordances, self.lane_change)
