"""What is stored of a decision, and what is learned from it: Algorithm 1, lines 6 and 8 to 12.

The outcomes of actions that were not taken are computed: counterfactual data augmentation (Pitis,
Creager and Garg, 2020). The motion of the ego after each action is known exactly. The other
vehicles hardly react to the ego within one decision, so their real motion is used.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.affordances import Affordances, Neighbor
from drl_av.driving.maneuver import plan
from drl_av.driving.mirror import MIRROR, Mirror, mirrored_observations
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.reward import desired, rewards, speed_bonus
from drl_av.env.transition import Transition
from drl_av.errors import ConfigError
from drl_av.learning.replay import Batch, Buffer
from drl_av.road.road import Road, SpeedLimit
from drl_av.road.snapshot import EGO


class TransitionWriter:
    """Stores each decision as experience: Algorithm 1 of the paper, lines 6 and 8 to 12.

    Buf_C receives each proposal that the check replaced and each executed action that led to a
    collision, both as terminal transitions with reward r_col. Buf_S receives all other executed
    actions. Ours:

    - A missed exit counts as a collision.
    - ``learning.speed_weight`` adds a bonus for speed to the stored reward.
    - With ``learning.unsafe_penalty``, a proposal that the check replaced is not terminal: it is
      stored with the next state of the executed action, and with the reward of that action minus
      the penalty. If the decision failed, it is terminal all the same.
    - ``learning.counterfactuals`` of the 12 actions are drawn after each decision, and the computed
      outcomes of those that were not taken are stored too. After a failed decision none is drawn,
      because the outcomes of other actions are unknown.
    """

    def __init__(self, buffer: Buffer, env: HighwayEnv, rng: np.random.Generator) -> None:
        self._buffer, self._env, self._rng = buffer, env, rng
        self._config = env.config

    def __call__(self, decision: Transition) -> None:
        """Store a decision."""
        config, buffer, failed = self._config, self._buffer, decision.failed
        s_t, s_tp1 = decision.observation, decision.next_observation
        proposed, executed = decision.proposed.number, decision.executed.number
        r_col, penalty = config.reward.collision_reward, config.learning.unsafe_penalty
        speed_m_s = decision.next_scene.affordances.ego_speed_m_s
        r_tp1 = decision.reward + speed_bonus(speed_m_s, config.ego, config.learning.speed_weight)
        if decision.triggered and penalty and not failed:
            buffer.add_unsafe(s_t, proposed, r_tp1 - penalty, s_tp1)
        elif decision.triggered:
            buffer.add_collision(s_t, proposed, r_col)  # line 6
        if failed:
            buffer.add_collision(s_t, executed, r_col)  # line 9
            return
        buffer.add_safe(s_t, executed, r_tp1, s_tp1)  # line 11
        if count := config.learning.counterfactuals:
            drawn = [ACTIONS[n] for n in self._rng.choice(len(ACTIONS), count, replace=False)]
            taken = (decision.proposed, decision.executed)
            self.add_counterfactuals(decision, [one for one in drawn if one not in taken])

    def add_counterfactuals(self, decision: Transition, others: Iterable[Action]) -> None:
        """Store the transition that each of the actions ``others`` would have caused, if known.

        - An action that the check replaces is stored as terminal with reward r_col (line 6 of the
          paper's Algorithm 1). If ``learning.unsafe_penalty`` is set, it is instead stored like the
          action that replaces it, but with the penalty subtracted from the reward.
        - An action that leaves the open lanes is also stored as terminal with reward r_col.
        - For every other action ``affordances_after`` computes the next state. It assumes that the
          other vehicles move as they did. If it returns None, nothing is stored.
        """
        env, buffer, config = self._env, self._buffer, self._config
        before, s_t = decision.scene, decision.observation
        after, penalty = decision.next_scene.affordances, config.learning.unsafe_penalty
        made = motion(before, decision.executed, config)
        ego = before.snapshot
        front_m, width_m = float(ego.s_m[EGO] + ego.length_m[EGO] / 2), float(ego.width_m[EGO])
        for other in others:
            permitted = env.safety_check(before, other).action
            unsafe = permitted != other
            imagined = motion(before, permitted if penalty else other, config)
            on_road = imagined.y_m == before.affordances.ego_y_m or env.road.holds(
                imagined.y_m, width_m, front_m + imagined.distance_m
            )
            if not on_road or (unsafe and not penalty):
                buffer.add_collision(s_t, other.number, config.reward.collision_reward)
                continue
            affordances = affordances_after(imagined, made, after, env.road)
            if affordances is None:
                continue
            target = desired(affordances, config.reward, config.safety)
            r_tp1 = rewards(affordances, target, config.reward, config.safety.minimum_gap_m).total
            r_tp1 += speed_bonus(
                affordances.ego_speed_m_s, config.ego, config.learning.speed_weight
            )
            s_tp1 = env.observation_of(decision.next_scene._replace(affordances=affordances))
            if unsafe:
                buffer.add_unsafe(s_t, other.number, r_tp1 - penalty, s_tp1)
            else:
                buffer.add_safe(s_t, other.number, r_tp1, s_tp1)


def require_symmetry(config: Config, road: Road) -> None:
    """Raise ConfigError if ``learning.mirrored`` is set, but the reward is not symmetric.

    The reward is symmetric if exchanging left and right does not change it. It is not symmetric if
    y_des is fixed at another position than the middle of the road.
    """
    middle_m = road.center_m(len(road.open_lanes) - 1) / 2
    fixed = config.learning.mirrored and config.reward.desired == "fixed"
    if fixed and config.reward.desired_lateral_m != middle_m:
        raise ConfigError(
            f"reward.desired_lateral_m = {config.reward.desired_lateral_m:g} is not the middle of "
            f"the road, {middle_m:g} m: learn there with learning.mirrored = false."
        )


def mirror_half(batch: Batch, mirror: Mirror = MIRROR) -> Batch:
    """Exchange left and right in every second transition of a minibatch, in place; return it.

    The rows of the safe buffer precede those of the collision buffer, so half of each is mirrored.
    The rewards stay as they are, because the reward is symmetric.
    """
    for s in (batch.s_t, batch.s_tp1):
        s[::2] = mirrored_observations(s[::2], mirror)
    batch.a_t[::2] = mirror.action_permutation[batch.a_t[::2]]
    return batch


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
