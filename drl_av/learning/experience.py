"""Stores each decision as experience: Algorithm 1 of the paper, lines 6 and 8 to 12."""

from collections.abc import Callable

from drl_av.config import Config
from drl_av.driving.actions import Action
from drl_av.driving.maneuver import aborts
from drl_av.driving.scene import Scene
from drl_av.env.decision import Decision
from drl_av.env.reward import speed_bonus
from drl_av.learning.buffers import Buffer

Store = Callable[[Decision], None]
"""A function that stores a decision in the buffers."""


def discomfort(scene: Scene, action: Action, config: Config) -> float:
    """Return the penalty of an action for its acceleration and for an aborted lane change (ours).

    ``learning.acceleration_penalty`` and ``learning.abort_penalty`` set it; by default it is 0.
    """
    acceleration_m_s2 = action.longitudinal.acceleration_m_s2(config.ego)
    penalty = config.learning.acceleration_penalty * abs(acceleration_m_s2)
    is_abort = aborts(scene.lane_change, action.lateral)
    return penalty + config.learning.abort_penalty * is_abort


class StoreDecision:
    """Stores a decision as Algorithm 1 of the paper does.

    Buf_C receives each proposal that the check replaced and each executed action that led to a
    collision, both as terminal transitions with reward r_col. Buf_S receives all other executed
    actions. Ours: a missed exit counts as a collision, the stored reward includes a bonus for speed
    with ``learning.speed_weight``, and the ``discomfort`` of the stored action is subtracted.
    """

    def __init__(self, buffer: Buffer, config: Config) -> None:
        self._buffer, self._config = buffer, config
        self._r_col = config.reward.collision_reward

    def __call__(self, decision: Decision) -> None:
        """Store a decision: Algorithm 1 of the paper, lines 6 and 8 to 12."""
        speed_m_s = decision.next_scene.affordances.ego_speed_m_s
        weight = self._config.learning.speed_weight
        r_tp1 = decision.reward + speed_bonus(speed_m_s, self._config.ego, weight)
        s_t, executed = decision.observation, decision.executed
        if decision.triggered:
            self.store_unsafe(decision, r_tp1)
        if decision.failed:
            self._buffer.add_collision(s_t, executed.number, self._r_col)
        else:
            r_tp1 -= discomfort(decision.scene, executed, self._config)
            self._buffer.add_safe(s_t, executed.number, r_tp1, decision.next_observation)

    def store_unsafe(self, decision: Decision, r_tp1: float) -> None:
        """Store the proposal that the check replaced, as terminal with reward r_col.

        This is line 6 of Algorithm 1 of the paper, which does not use ``r_tp1``.
        """
        self._buffer.add_collision(decision.observation, decision.proposed.number, self._r_col)


class StoreWithPenalty(StoreDecision):
    """Stores unsafe proposals with a penalty, instead of as terminal transitions (ours).

    An unsafe proposal is one that the check replaced. It is stored with the next state of the
    executed action, and with the reward of that action minus ``learning.unsafe_penalty`` and minus
    its own ``discomfort``. Only if the ego collided is it stored as terminal with reward r_col.
    """

    def store_unsafe(self, decision: Decision, r_tp1: float) -> None:
        """Store the proposal with the executed action's next state, and r_tp1 minus penalties."""
        if decision.terminated:
            super().store_unsafe(decision, r_tp1)
            return
        s_t, proposed, s_tp1 = decision.observation, decision.proposed, decision.next_observation
        r_tp1 -= self._config.learning.unsafe_penalty
        r_tp1 -= discomfort(decision.scene, proposed, self._config)
        self._buffer.add_unsafe(s_t, proposed.number, r_tp1, s_tp1)
