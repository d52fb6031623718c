"""How a decision becomes rows of the safe and of the collision buffer."""

from typing import Any

import numpy as np
from decisions import decided

from drl_av.config import LearningConfig
from drl_av.driving.affordances import INDICATORS
from drl_av.env.transition import Transition
from drl_av.learning.algorithm_1 import store
from drl_av.learning.replay import TwoBuffers
from drl_av.safety.check import Rule

HARD_BRAKE, LEFT = 3, 8
N, R_COL, GAMMA = len(INDICATORS), -3.0, np.float32(0.9)
BEFORE, AFTER = np.full(N, 0.125, np.float32), np.full(N, 0.25, np.float32)


def decision(
    executed: int = LEFT, rule: Rule = Rule.NONE, reward: float = -0.25, **fields: Any
) -> Transition:
    """A proposal to change to the left, at 20 m/s."""
    given = {"reward": reward, "observation": BEFORE, "next_observation": AFTER} | fields
    return decided(executed=executed, proposed=LEFT, rule=rule, **given)


UNSAFE = decision(HARD_BRAKE, Rule.IN_LANE)
UNSAFE_COLLISION = decision(HARD_BRAKE, Rule.IN_LANE, R_COL, terminated=True)


def stored(*decisions: Transition) -> tuple[np.ndarray, np.ndarray]:
    """The rows of Buf_S and of Buf_C."""
    buffer = TwoBuffers(N, LearningConfig(safe_capacity=10, collision_capacity=10))
    for each in decisions:
        store(each, buffer, R_COL)
    return (buffer.safe.rows[: len(buffer.safe)], buffer.collision.rows[: len(buffer.collision)])


def ends(rows: np.ndarray) -> list[tuple[int, float, float]]:
    """Action, reward and discount of each row."""
    return [*zip(*(rows[name].tolist() for name in ("a_t", "r_tp1", "discount")), strict=True)]


def test_unsafe_proposal_is_a_collision_and_the_executed_action_is_safe() -> None:
    safe, collision = stored(decision(reward=-0.5), UNSAFE)
    assert (len(safe), len(collision)) == (2, 1)
    np.testing.assert_array_equal(collision["s_t"][0], BEFORE)
    assert ends(collision) == [(LEFT, R_COL, 0.0)]
    np.testing.assert_array_equal(safe["s_t"][1], BEFORE)
    np.testing.assert_array_equal(safe["s_tp1"][1], AFTER)
    assert ends(safe) == [(LEFT, -0.5, GAMMA), (HARD_BRAKE, -0.25, GAMMA)]


def test_collision_goes_to_the_collision_buffer_alone_with_its_reward() -> None:
    safe, collision = stored(decision(reward=-7.0, terminated=True))  # of the user's own function
    assert len(safe) == 0
    assert ends(collision) == [(LEFT, -7.0, 0.0)]


def test_collision_of_an_overruled_proposal_blames_the_executed_action_too() -> None:
    safe, collision = stored(UNSAFE_COLLISION)
    assert len(safe) == 0
    assert collision["a_t"].tolist() == [LEFT, HARD_BRAKE]


def test_a_missed_exit_is_worth_as_little_as_a_collision() -> None:
    safe, collision = stored(decision(missed_exit=True))
    assert (len(safe), len(collision)) == (0, 1)
    assert ends(collision) == [(LEFT, R_COL, 0.0)]
