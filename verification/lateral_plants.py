"""The ego's lateral plants for many scenes at once: its lateral motion in one SUMO step.

The steering law is that of ``drl_av/driving/maneuver.py``. This module detects no collisions. All
arrays have shape (scenes,).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.config import EgoConfig
from drl_av.driving.maneuver import Pose, settled, steer
from drl_av.road.road import FloatArray

BoolArray = npt.NDArray[np.bool_]


class Aside(NamedTuple):
    """The ego's lateral state in each scene."""

    y_m: FloatArray
    lateral_m_s: FloatArray
    """Lateral speed, left positive."""
    heading_rad: FloatArray
    """Angle between the ego and its lane, left positive; 0 with the kinematic plant."""


class Lanes(NamedTuple):
    """Which egos of many scenes change lanes in a step, and to where; arrays of shape (scenes,)."""

    changing: BoolArray
    """Whether the ego changes lanes in each scene."""
    target_m: FloatArray
    """Lateral position of the target lane's centre; arbitrary without a lane change."""
    width_m: float
    """Width of each lane."""


def kinematic(
    at: Aside, lanes: Lanes, speed_m_s: FloatArray, ego: EgoConfig, step_s: float
) -> tuple[Aside, BoolArray]:
    """Move the ego at constant lateral speed (eq. 6 of the paper); ``speed_m_s`` has no effect.

    Returns the state after the step, and whether the ego arrives at the target lane.
    """
    stride_m = lanes.width_m / ego.lane_change_duration_s * step_s
    left_m = lanes.target_m - at.y_m
    arrives = lanes.changing & (np.abs(left_m) <= stride_m + 1e-6)
    goes_m = np.where(lanes.changing, np.sign(left_m) * stride_m, 0.0)
    moved_m = np.where(arrives, left_m, goes_m)
    return Aside(at.y_m + moved_m, moved_m / step_s, at.heading_rad), arrives


def steering(
    at: Aside, lanes: Lanes, speed_m_s: FloatArray, ego: EgoConfig, step_s: float
) -> tuple[Aside, BoolArray]:
    """Steer the ego like the vehicle of Sec. III of the paper; its speed in the step is given.

    Returns the state after the step, and whether the ego arrives at the target lane.
    """
    y_m, lateral_m_s, heading_rad = at.y_m.copy(), np.zeros(len(at.y_m)), at.heading_rad.copy()
    arrives = np.zeros(len(y_m), dtype=np.bool_)
    for row in np.flatnonzero(lanes.changing).tolist():
        target_m, speed = float(lanes.target_m[row]), float(speed_m_s[row])
        pose = Pose(float(y_m[row]), float(heading_rad[row]))
        pose = steer(pose, target_m, speed, step_s, lanes.width_m, ego)
        arrives[row] = settled(pose, target_m, speed, lanes.width_m, ego)
        if arrives[row]:
            pose = Pose(target_m, 0.0)
        y_m[row], heading_rad[row] = pose
        lateral_m_s[row] = speed * math.tan(pose.heading_rad)
    return Aside(y_m, lateral_m_s, heading_rad), arrives


Plant = Callable[[Aside, Lanes, FloatArray, EgoConfig, float], tuple[Aside, BoolArray]]
PLANTS: dict[str, Plant] = {"kinematic": kinematic, "steering": steering}
"""The plant of each value of ``ego.lateral_plant``."""
