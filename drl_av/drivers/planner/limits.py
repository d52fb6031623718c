"""Computes what the checks ``paper`` and ``strict`` permit in many forecasts at once (ours).

The two classes apply the equations of the checks to the ego's neighbours. Arrays have shape (P,)
for P forecasts. ``speed`` is the ego's speed, m/s. A lane change is permitted if the vehicles ahead
in both lanes (``clear_ahead``) and the vehicle behind in the target lane (``clear_behind``) permit
it. In these two methods the gap must be larger than necessary by ``margin_m``, and ``rate`` is the
ego's acceleration in the next second, m/s^2, not above 0.

The safety check of the environment still examines the action that the driver proposes.
"""

from typing import Any, NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.drivers.planner.others import BoolArray
from drl_av.road.road import FloatArray
from drl_av.safety.paper import gap_condition
from drl_av.safety.stopping import reach, stopping_distance


class NextVehicle(NamedTuple):
    """The next vehicle ahead or behind in a lane, in each forecast; arrays of shape (P,)."""

    gap_m: FloatArray
    speed_m_s: FloatArray

    def where(self, condition: BoolArray, other: "NextVehicle") -> "NextVehicle":
        """Return this vehicle where ``condition`` holds, and the vehicle ``other`` elsewhere."""
        return NextVehicle(
            *(np.where(condition, mine, its) for mine, its in zip(self, other, strict=True))
        )


class PaperLimits:
    """Computes what rules 1 and 3 of the check ``paper`` permit."""

    followers_stay_behind = False
    """Whether the check ignores the vehicles behind the ego in the lane of the ego's centre."""

    def __init__(self, config: Config) -> None:
        self._safety, self._ego = config.safety, config.ego

    def fastest(self, speed: FloatArray, front: NextVehicle) -> FloatArray:
        """Return the permitted acceleration, m/s^2.

        It is the largest one if the gap condition (eq. 3 of the paper) holds, and otherwise the
        safe action (eq. 4).
        """
        safety, ego, closing = self._safety, self._ego, speed - front.speed_m_s
        free = (closing <= 0) | gap_condition(front.gap_m, closing, safety)
        ttc_s = front.gap_m / np.maximum(closing, 1e-6)
        mild = np.where(ttc_s <= safety.brake_ttc_s, -ego.brake_m_s2, 0.0)
        safe = np.where(ttc_s <= safety.hard_brake_ttc_s, -ego.hard_brake_m_s2, mild)
        return np.where(free, ego.accelerate_m_s2, safe)

    def clear_ahead(
        self, speed: FloatArray, front: NextVehicle, margin_m: Any = 0.0, rate: float = 0.0
    ) -> BoolArray:
        """Return whether the gap condition (eq. 3) holds for the vehicle ahead (rule 3)."""
        closing = speed - front.speed_m_s
        permitted: BoolArray = gap_condition(front.gap_m - margin_m, closing, self._safety)
        return permitted

    def clear_behind(
        self, speed: FloatArray, rear: NextVehicle, margin_m: Any = 0.0, rate: float = 0.0
    ) -> BoolArray:
        """Return whether the gap condition (eq. 3) holds for the vehicle behind (rule 3)."""
        closing = rear.speed_m_s - speed
        permitted: BoolArray = gap_condition(rear.gap_m - margin_m, closing, self._safety)
        return permitted


class StrictLimits:
    """Computes what the check ``strict`` permits, from its stopping distances."""

    followers_stay_behind = True

    def __init__(self, config: Config) -> None:
        self._strict, self._ego, self._simulation = config.strict, config.ego, config.simulation
        ego = config.ego
        self._rates = np.array([ego.accelerate_m_s2, 0.0, -ego.brake_m_s2, -ego.hard_brake_m_s2])
        by_number = ego.longitudinal_reference == "acceleration"
        self._slowest = 0.0 if by_number else -ego.hard_brake_m_s2

    def fastest(self, speed: FloatArray, front: NextVehicle) -> FloatArray:
        """Return the largest acceleration, m/s^2, after which the ego can stop behind ``front``."""
        reaches = reach(speed, self._rates[:, None], self._ego, self._simulation)
        permitted = reaches < self._most_m(front)
        permitted[-1] = True
        fastest: FloatArray = self._rates[permitted.argmax(axis=0)]
        return fastest

    def clear_ahead(
        self, speed: FloatArray, front: NextVehicle, margin_m: Any = 0.0, rate: float = 0.0
    ) -> BoolArray:
        """Return whether the ego can stop behind ``front`` after a second with ``rate``."""
        reached_m = reach(speed, rate, self._ego, self._simulation)
        permitted: BoolArray = reached_m < self._most_m(front) - margin_m
        return permitted

    def clear_behind(
        self, speed: FloatArray, rear: NextVehicle, margin_m: Any = 0.0, rate: float = 0.0
    ) -> BoolArray:
        """Return whether the vehicle behind can stop behind the ego.

        This holds even if the ego brakes hard from the next decision on.
        """
        strict, step_s = self._strict, self._simulation.step_length_s
        least_m = reach(speed, min(rate, self._slowest), self._ego, self._simulation)
        delay_s = strict.follower_response_s + self._simulation.decision_interval_s / 2
        faster = rear.speed_m_s + strict.acceleration_m_s2 * delay_s
        rolled_m = (rear.speed_m_s + faster + strict.acceleration_m_s2 * step_s) / 2 * delay_s
        rolled_m = rolled_m + stopping_distance(faster, strict.follower_braking_m_s2, step_s)
        permitted: BoolArray = least_m > rolled_m - rear.gap_m + strict.clearance_m + margin_m
        return permitted

    def _most_m(self, front: NextVehicle) -> FloatArray:
        strict, step_s = self._strict, self._simulation.step_length_s
        stop_m = stopping_distance(front.speed_m_s, strict.braking_m_s2, step_s)
        most_m: FloatArray = front.gap_m + stop_m - strict.clearance_m
        return most_m


Limits = PaperLimits | StrictLimits


def limits_of(config: Config) -> Limits:
    """Return the limits of ``strict`` if the config names it, else those of ``paper``."""
    return StrictLimits(config) if config.safety.check == "strict" else PaperLimits(config)
