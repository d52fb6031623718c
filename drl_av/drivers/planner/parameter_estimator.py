"""Estimates of the other vehicles' desired speeds and time gaps from their motion (ours)."""

from typing import NamedTuple

import numpy as np

from drl_av.drivers.planner.others import (
    ACCELERATION_M_S2,
    COMFORTABLE_BRAKING_M_S2,
    STANDSTILL_GAP_M,
    Others,
    wanted_gap,
)
from drl_av.road.road import FloatArray

USUAL_SPEED_M_S = 26.0
"""First estimate of a vehicle's desired speed; for a faster vehicle it is its present speed."""
USUAL_HEADWAY_S = 1.1
FASTEST_M_S = 40.0
HEADWAYS_S = (0.4, 2.0)
MEMORY = 5.0
"""The estimate of a desired speed is about the mean of the last ``MEMORY`` observations."""
FORGETTING = 0.3
"""Weight of a new observation in the estimate of a time gap."""


class Ahead(NamedTuple):
    """Gap and closing speed of each of N vehicles to its leader, which may be the ego.

    The arrays have shape (N,).
    """

    gap_m: FloatArray
    closing_m_s: FloatArray


class ParameterEstimator:
    """Estimates the desired speed and the time gap of each other vehicle of an episode.

    The motion of a vehicle on a free road reveals its desired speed, and the motion of a vehicle
    behind a leader its time gap. Each observation is the value with which IDM yields the observed
    acceleration.
    """

    def __init__(self, others: Others) -> None:
        speed = others.speed_m_s
        self.desired_m_s = np.maximum(speed, USUAL_SPEED_M_S)
        self.headway_s = np.full(len(speed), USUAL_HEADWAY_S)
        self._known = np.zeros(len(speed))
        self._speed, self._ids = speed, others.ids

    def observe(self, others: Others, ahead: Ahead, seconds: float) -> None:
        """Update the estimates; ``seconds`` is the time since the last observation."""
        if others.ids != self._ids:
            self._keep_known(others)
        speed = others.speed_m_s
        rate = (speed - self._speed) / seconds / ACCELERATION_M_S2
        self._speed = speed
        self._observe_desired(speed, rate, ahead)
        self._observe_headway(speed, rate, ahead)

    def _keep_known(self, others: Others) -> None:
        """Remove the vehicles that have left the road, and add those that have entered it."""
        rows = {name: row for row, name in enumerate(self._ids)}
        new = [row for row, name in enumerate(others.ids) if name in rows]
        old = [rows[others.ids[row]] for row in new]

        def kept(known: FloatArray, begun: FloatArray) -> FloatArray:
            values = begun.copy()
            values[new] = known[old]
            return values

        fresh = ParameterEstimator(others)
        self.desired_m_s = kept(self.desired_m_s, fresh.desired_m_s)
        self.headway_s = kept(self.headway_s, fresh.headway_s)
        self._known = kept(self._known, fresh._known)
        self._speed, self._ids = kept(self._speed, fresh._speed), others.ids

    def _observe_desired(self, speed: FloatArray, rate: FloatArray, ahead: Ahead) -> None:
        """Update the desired speeds v_0 by IDM, solved for v_0.

        v_0 = v / (1 - a_observed / a - (s* / s)^2)^(1/4). The estimates of vehicles near a leader
        are not updated.
        """
        wanted_m = wanted_gap(speed, ahead.closing_m_s, self.headway_s)
        interaction = (wanted_m / np.maximum(ahead.gap_m, 0.1)) ** 2
        left = 1 - rate - interaction
        seen = np.clip(speed / np.maximum(left, 0.2) ** 0.25, 0.1, FASTEST_M_S)
        weight = np.clip(1 - 2 * interaction, 0.0, 1.0) * (left > 0.2)
        self._known = np.minimum(self._known + weight, MEMORY)
        self.desired_m_s += weight / np.maximum(self._known, 1e-9) * (seen - self.desired_m_s)
        self.desired_m_s = np.maximum(self.desired_m_s, np.maximum(speed, 0.1))

    def _observe_headway(self, speed: FloatArray, rate: FloatArray, ahead: Ahead) -> None:
        """Update the time gaps of vehicles behind a leader by IDM, solved for the time gap.

        The time gap follows from s* = s (1 - a_observed / a - (v / v_0)^4)^(1/2).
        """
        left = np.clip(1 - rate - (speed / self.desired_m_s) ** 4, 0.0, 4.0)
        braking = 2 * (ACCELERATION_M_S2 * COMFORTABLE_BRAKING_M_S2) ** 0.5
        wanted_s = (ahead.gap_m * left**0.5 - STANDSTILL_GAP_M) / np.maximum(speed, 1.0)
        seen = np.clip(wanted_s - ahead.closing_m_s / braking, *HEADWAYS_S)
        follows = (ahead.gap_m < 2.5 * speed + 10) & (speed > 3.0)
        self.headway_s += np.where(follows, FORGETTING, 0.0) * (seen - self.headway_s)
