"""Surrogate safety measures and bounds of comfort, as pure functions."""

import math
from typing import NamedTuple

import numpy as np

from drl_av.road.road import FloatArray

LONGITUDINAL_M_S2 = (-4.05, 2.40)
LATERAL_M_S2 = 4.89
LONGITUDINAL_JERK_M_S3 = 4.13
JERK_M_S3 = 8.37
YAW_RATE_RAD_S = 0.95
YAW_ACCELERATION_RAD_S2 = 1.93
"""The bounds of nuPlan's metric ``ego_is_comfortable``.

All bounds except the interval ``LONGITUDINAL_M_S2`` apply to absolute values.

Source: the experiment configuration of motional/nuplan-devkit.
"""


class Motion(NamedTuple):
    """Accelerations, jerks and yaw motion of the ego; x is along the road, y to the left."""

    a_x_m_s2: float
    a_y_m_s2: float
    j_x_m_s3: float
    j_y_m_s3: float
    yaw_rate_rad_s: float
    yaw_acceleration_rad_s2: float

    @property
    def comfortable(self) -> bool:
        """Whether all values are within nuPlan's bounds of comfort."""
        least, most = LONGITUDINAL_M_S2
        return (
            least <= self.a_x_m_s2 <= most
            and abs(self.a_y_m_s2) <= LATERAL_M_S2
            and abs(self.j_x_m_s3) <= LONGITUDINAL_JERK_M_S3
            and math.hypot(self.j_x_m_s3, self.j_y_m_s3) <= JERK_M_S3
            and abs(self.yaw_rate_rad_s) <= YAW_RATE_RAD_S
            and abs(self.yaw_acceleration_rad_s2) <= YAW_ACCELERATION_RAD_S2
        )


def required_deceleration(gap_m: float, closing_m_s: float) -> float:
    """Return DRAC, the deceleration to avoid a crash: closing speed^2 / (2 gap), m/s^2.

    It is 0 if the gap does not shrink, and inf if there is no gap. The vehicle ahead is assumed to
    keep its speed (Cooper and Ferguson, 1976). SUMO's SSM device computes the same.
    """
    if closing_m_s <= 0.0:
        return 0.0
    return closing_m_s**2 / (2.0 * gap_m) if gap_m > 0.0 else math.inf


class Track(NamedTuple):
    """The states of one vehicle at T moments; each array has shape (T,)."""

    time_s: FloatArray
    s_m: FloatArray
    """Position of the body's centre along the road."""
    y_m: FloatArray
    length_m: FloatArray
    width_m: FloatArray


def post_encroachment_time(first: Track, second: Track, lap_m: float) -> float:
    """Return the smallest PET with ``first`` ahead and ``second`` behind it, seconds.

    PET (post-encroachment time) is the time from the moment at which the rear of ``first`` leaves a
    place to the moment at which the front of ``second`` arrives there (Allen, Shin and Cooper,
    1978). It is inf if ``second`` never arrives. The places are those of the rear of ``first`` at
    each moment, over its whole width. Between two moments ``second`` moves on a straight line. If
    both vehicles have the same speed, the PET is the time gap.

    Args:
        first: The vehicle that leaves.
        second: The vehicle that arrives, at the same moments; it never drives backwards.
        lap_m: Length of the loop; 0 on an open road.
    """
    steps_m, ahead_m = np.diff(second.s_m), first.s_m - second.s_m
    if lap_m:
        steps_m = (steps_m + lap_m / 2) % lap_m - lap_m / 2
        ahead_m = ahead_m % lap_m
    driven_m = np.concatenate(([0.0], np.cumsum(steps_m)))
    gap_m = ahead_m - (first.length_m + second.length_m) / 2
    place_m = driven_m + gap_m
    arrival_s = np.interp(place_m, driven_m, second.time_s)
    y_m = np.interp(arrival_s, second.time_s, second.y_m)
    reached = (gap_m >= 0.0) & (place_m <= driven_m[-1])
    reached &= abs(y_m - first.y_m) < (first.width_m + second.width_m) / 2
    return float((arrival_s - first.time_s)[reached].min(initial=math.inf))
