"""The affordances that the ego would have after another action than the executed one (ours).

This is counterfactual data augmentation (Pitis, Creager and Garg, 2020). The motion of the ego
after each action is known exactly. The other vehicles hardly react to the ego within one decision,
so their real motion is used.
"""

from typing import NamedTuple

from drl_av.config import Config
from drl_av.driving.actions import Action
from drl_av.driving.affordances import Affordances, Neighbor
from drl_av.driving.maneuver import plan
from drl_av.driving.scene import Scene
from drl_av.road.road import Road, SpeedLimit


class Motion(NamedTuple):
    """The motion of the ego in one decision, and its state after the decision."""

    distance_m: float
    """Distance that the ego covers, with semi-implicit Euler integration as in SUMO."""
    speed_m_s: float
    y_m: float
    lateral_speed_m_s: float


def motion(scene: Scene, action: Action, config: Config) -> Motion:
    """Return the motion of the ego in one decision if it executes ``action`` in ``scene``."""
    commands, _ = plan(scene, action, config.ego, config.simulation)
    distance_m = config.simulation.step_length_s * sum(command.speed_m_s for command in commands)
    return Motion(distance_m, *commands[-1])


def affordances_after(
    other: Motion, made: Motion, affordances: Affordances, road: Road
) -> Affordances | None:
    """Return the affordances that the ego would have if it had made another motion.

    Each neighbour ahead remains a neighbour ahead, and each one behind remains behind, even if the
    motion ``other`` makes the opposite way around a loop shorter.

    Args:
        other: The motion that the ego did not make.
        made: The motion that the ego made.
        affordances: The affordances after the motion ``made``.
        road: The road.

    Returns:
        The affordances after the motion ``other``. The result is None if the ego would be in
        another lane, where its neighbours are unknown, or if a neighbour is beside the ego after
        either motion.
    """
    y_m = affordances.ego_y_m + other.y_m - made.y_m
    if road.lane_of(y_m) != affordances.lane:
        return None
    further_m = other.distance_m - made.distance_m
    faster_m_s = other.speed_m_s - made.speed_m_s
    leftwards_m_s = other.lateral_speed_m_s - made.lateral_speed_m_s

    neighbors: list[Neighbor | None] = []
    for toward, neighbor in zip((-1, 1) * 3, affordances[:6], strict=True):
        if neighbor is None:
            neighbors.append(None)
            continue
        gap_m = neighbor.gap_m + toward * further_m
        if neighbor.gap_m == 0.0 or gap_m <= 0.0:
            return None
        moved = Neighbor(
            neighbor.vehicle,
            gap_m,
            neighbor.relative_speed_m_s - faster_m_s,
            neighbor.lateral_offset_m - (y_m - affordances.ego_y_m),
            neighbor.relative_lateral_speed_m_s - leftwards_m_s,
        )
        neighbors.append(moved if gap_m <= affordances.range_m else None)
    mandatory = affordances.mandatory
    if mandatory.within_m <= further_m:
        return None
    own_front, own_rear, right_front, right_rear, left_front, left_rear = neighbors
    return affordances._replace(
        own_front=own_front,
        own_rear=own_rear,
        right_front=right_front,
        right_rear=right_rear,
        left_front=left_front,
        left_rear=left_rear,
        ego_speed_m_s=affordances.ego_speed_m_s + faster_m_s,
        ego_y_m=y_m,
        ego_lateral_speed_m_s=affordances.ego_lateral_speed_m_s + leftwards_m_s,
        barriers=tuple(gap._replace(s_m=gap.s_m - further_m) for gap in affordances.barriers),
        mandatory=mandatory._replace(within_m=mandatory.within_m - further_m),
        speed_limits=tuple(
            SpeedLimit(begin_m - further_m, end_m - further_m, limit_m_s)
            for begin_m, end_m, limit_m_s in affordances.speed_limits
        ),
    )
