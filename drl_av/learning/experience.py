"""Stores each decision as experience: Algorithm 1 of the paper, lines 6 and 8 to 12."""

from collections.abc import Callable

from drl_av.config import Config
from drl_av.env.reward import speed_bonus
from drl_av.env.transition import Transition
from drl_av.learning.buffers import Buffer

TransitionWriter = Callable[[Transition], None]
"""A function that stores a decision in the buffers."""


class StoreDecision:
    """Stores a decision as Algorithm 1 of the paper does.

    Buf_C receives each proposal that the check replaced and each executed action that led to a
    collision, both as terminal transitions with reward r_col. Buf_S receives all other executed
    actions. Ours: a missed exit counts as a collision, and with ``learning.speed_weight`` the
    stored reward includes a bonus for speed.
    """

    def __init__(self, buffer: Buffer, config: Config) -> None:
        self._buffer, self._ego = buffer, config.ego
        self._r_col = config.reward.collision_reward
        self._speed_weight = config.learning.speed_weight

    def __call__(self, decision: Transition) -> None:
        """Store a decision: Algorithm 1 of the paper, lines 6 and 8 to 12."""
        speed_m_s = decision.next_scene.affordances.ego_speed_m_s
        r_tp1 = decision.reward + speed_bonus(speed_m_s, self._ego, self._speed_weight)
        s_t, executed = decision.observation, decision.executed.number
        if decision.triggered:
            self.store_unsafe(decision, r_tp1)
        if decision.failed:
            self._buffer.add_collision(s_t, executed, self._r_col)
        else:
            self._buffer.add_safe(s_t, executed, r_tp1, decision.next_observation)

    def store_unsafe(self, decision: Transition, r_tp1: float) -> None:
        """Store the proposal that the check replaced, as terminal with reward r_col.

        This is line 6 of Algorithm 1 of the paper, which does not use ``r_tp1``.
        """
        self._buffer.add_collision(decision.observation, decision.proposed.number, self._r_col)


class TransitionWriterWithPenalty(StoreDecision):
    """Stores unsafe proposals with a penalty, instead of as terminal transitions (ours).

    An unsafe proposal is one that the check replaced. It is stored with the next state of the
    executed action, and with the reward of that action minus ``learning.unsafe_penalty``. If the
    decision failed, it is stored as terminal with reward r_col instead.
    """

    def __init__(self, buffer: Buffer, config: Config) -> None:
        super().__init__(buffer, config)
        self._penalty = config.learning.unsafe_penalty

    def store_unsafe(self, decision: Transition, r_tp1: float) -> None:
        """Store the proposal with the executed action's next state, and r_tp1 minus the penalty."""
        if decision.failed:
            super().store_unsafe(decision, r_tp1)
            return
        s_t, a_t, s_tp1 = decision.observation, decision.proposed.number, decision.next_observation
        self._buffer.add_unsafe(s_t, a_t, r_tp1 - self._penalty, s_tp1)
