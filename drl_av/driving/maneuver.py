"""A lane change in progress, and a decision turned into one command a SUMO step."""

from typing import NamedTuple

from drl_av.config import EgoConfig, SimulationConfig
from drl_av.driving.actions import Action, Lateral
from drl_av.driving.affordances import Affordances
from drl_av.traffic.snapshot import Command, Snapshot


class LaneChange(NamedTuple):
    """A lane change in progress, from the lane it came from to the lane it goes to.

    Where the ego is on the way stands in its lateral position alone: an abort turns the two
    lanes round, so that the way back takes as long as the way there.
    """

    origin: int
    target: int

    @property
    def sign(self) -> int:
        """Direction across the road: left +1, right -1."""
        return 1 if self.target > self.origin else -1

    def turned(self) -> "LaneChange":
        """The same lane change aborted."""
        return LaneChange(self.target, self.origin)


class Scene(NamedTuple):
    """All that a decision may rest on."""

    snapshot: Snapshot
    seen: Affordances
    lane_change: LaneChange | None


class Plan(NamedTuple):
    """The commands of one decision, and the lane change still in progress after it."""

    commands: list[Command]
    lane_change: LaneChange | None


def steered(lane_change: LaneChange | None, lane: int, lateral: Lateral) -> LaneChange | None:
    """The lane change that a lateral action starts, lets go on, or aborts (Sec. IV-A)."""
    if lane_change is None:
        return LaneChange(lane, lane + lateral.sign) if lateral.sign else None
    return lane_change.turned() if lateral.sign == -lane_change.sign else lane_change


def plan(scene: Scene, action: Action, ego: EgoConfig, simulation: SimulationConfig) -> Plan:
    """Turn a decision into commands with the point-mass model (eq. 4 and 5).

    The speed follows the acceleration step by step within [0, max_speed_m_s]; the lateral
    position moves a lane width in ``lane_change_duration_s`` and stops on the lane's centre.
    """
    seen = scene.seen
    lane_change = steered(scene.lane_change, seen.lane, action.lateral)
    acceleration = action.longitudinal.acceleration_m_s2(ego)
    rate_m_s = seen.lane_width_m / ego.lane_change_duration_s
    y_m, commands = seen.ego_y_m, []
    for step in range(1, simulation.steps_per_decision + 1):
        speed = seen.ego_speed_m_s + acceleration * step * simulation.step_length_s
        lateral_speed = 0.0
        if lane_change is not None:
            target_m = lane_change.target * seen.lane_width_m
            stride_m = rate_m_s * simulation.step_length_s
            if abs(target_m - y_m) <= stride_m + 1e-6:
                y_m, lane_change = target_m, None
            else:
                y_m += lane_change.sign * stride_m
                lateral_speed = lane_change.sign * rate_m_s
        commands.append(Command(min(max(speed, 0.0), ego.max_speed_m_s), y_m, lateral_speed))
    return Plan(commands, lane_change)
