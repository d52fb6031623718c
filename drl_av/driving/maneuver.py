"""Execution of an action: the lane change in progress, and one command for each SUMO step."""

import math
from typing import NamedTuple

from drl_av.config import EgoConfig, SimulationConfig
from drl_av.driving.actions import Action, Lateral
from drl_av.driving.car_following import reference_speeds
from drl_av.driving.scene import LaneChange, Scene
from drl_av.driving.steering import Pose, settled, steer
from drl_av.road.snapshot import Command


class Plan(NamedTuple):
    """The commands of one decision, and the lane change in progress after it, or None."""

    commands: list[Command]
    lane_change: LaneChange | None


def next_lane_change(
    lane_change: LaneChange | None, lane: int, lateral: Lateral
) -> LaneChange | None:
    """Return the lane change after a lateral action starts, continues or aborts it (Sec. IV-A).

    ``lane_change`` is the lane change in progress, and ``lane`` the index of the ego's lane. None
    means that no lane change is in progress.
    """
    if lane_change is None:
        return LaneChange(lane, lane + lateral.sign) if lateral.sign else None
    return lane_change.reversed() if aborts(lane_change, lateral) else lane_change


def aborts(lane_change: LaneChange | None, lateral: Lateral) -> bool:
    """Whether a lateral action is opposite to the lane change in progress, and so aborts it."""
    return lane_change is not None and lateral.sign == -lane_change.sign


def target_lane(scene: Scene, lateral: Lateral) -> int:
    """Return the index of the lane in which the ego's lane change ends if it takes ``lateral``.

    The action may start, continue or abort the lane change. Without a lane change the result is the
    lane that contains the ego's centre.
    """
    change = next_lane_change(scene.lane_change, scene.affordances.lane, lateral)
    return scene.affordances.lane if change is None else change.target


class Sideways(NamedTuple):
    """The ego's lateral state after a SUMO step, and the lane change in progress, or None."""

    y_m: float
    lateral_speed_m_s: float
    lane_change: LaneChange | None


def plan(scene: Scene, action: Action, ego: EgoConfig, simulation: SimulationConfig) -> Plan:
    """Convert an action to the commands of one decision, one command for each SUMO step.

    The speed follows ``ego.longitudinal_reference``, in [0, max_speed_m_s]. The lateral position
    follows the model ``ego.lateral_plant``. With each of its two models, a lane change ends exactly
    at the lane's centre.
    """
    affordances, step_s, move = (
        scene.affordances,
        simulation.step_length_s,
        _PLANTS[ego.lateral_plant],
    )
    change = next_lane_change(scene.lane_change, affordances.lane, action.lateral)
    y_m, lateral_m_s, commands = affordances.ego_y_m, 0.0, []
    for speed in reference_speeds(affordances, action.longitudinal, ego, simulation):
        if change is not None:
            y_m, lateral_m_s, change = move(
                y_m, change, speed, affordances.lane_width_m, ego, step_s
            )
        commands.append(Command(speed, y_m, lateral_m_s))
    return Plan(commands, change)


def _kinematic(
    y_m: float,
    lane_change: LaneChange,
    speed_m_s: float,
    lane_width_m: float,
    ego: EgoConfig,
    step_s: float,
) -> Sideways:
    """Move the ego at one lane width per T_LC towards the target lane (eq. 6 of the paper)."""
    target_m = lane_change.target * lane_width_m
    rate_m_s = lane_width_m / ego.lane_change_duration_s
    stride_m = rate_m_s * step_s
    if abs(target_m - y_m) <= stride_m + 1e-6:
        return Sideways(target_m, 0.0, None)
    sign = lane_change.sign
    return Sideways(y_m + sign * stride_m, sign * rate_m_s, lane_change)


def _steering(
    y_m: float,
    lane_change: LaneChange,
    speed_m_s: float,
    lane_width_m: float,
    ego: EgoConfig,
    step_s: float,
) -> Sideways:
    """Steer the vehicle of Sec. III of the paper; once settled it is exactly at the centre."""
    target_m, pose = lane_change.target * lane_width_m, Pose(y_m, lane_change.heading_rad)
    pose = steer(pose, target_m, speed_m_s, step_s, lane_width_m, ego)
    if settled(pose, target_m, speed_m_s, lane_width_m, ego):
        return Sideways(target_m, 0.0, None)
    lateral_speed = speed_m_s * math.tan(pose.heading_rad)
    return Sideways(pose.y_m, lateral_speed, lane_change._replace(heading_rad=pose.heading_rad))


_PLANTS = {"kinematic": _kinematic, "steering": _steering}
