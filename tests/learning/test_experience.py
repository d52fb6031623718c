"""How a decision becomes rows of the safe and of the collision buffer."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from decisions import decided

from drl_av.config import Config
from drl_av.driving.affordances import INDICATORS
from drl_av.env.transition import Transition
from drl_av.learning.experience import TransitionWriter
from drl_av.learning.prioritized import PrioritizedBuffer
from drl_av.learning.replay import Buffer, TwoBuffers, UniformBuffer
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


def two_buffers() -> TwoBuffers:
    return TwoBuffers(N, 10, 10, discount=0.9, collision_fraction=0.25)


def writer(buffer: Buffer, **learning: float) -> TransitionWriter:
    env: Any = SimpleNamespace(config=Config().updated("learning", **learning))
    return TransitionWriter(buffer, env, np.random.default_rng(0))


def stored(*decisions: Transition, **learning: float) -> tuple[np.ndarray, np.ndarray]:
    """The rows of Buf_S and of Buf_C."""
    buffer = two_buffers()
    store = writer(buffer, **learning)
    for each in decisions:
        store(each)
    return (
        buffer.safe.rows[: len(buffer.safe)],
        buffer.collision.rows[: len(buffer.collision)],
    )


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


def test_collision_goes_to_the_collision_buffer_alone_whatever_its_reward() -> None:
    safe, collision = stored(decision(reward=-7.0, terminated=True))
    assert len(safe) == 0
    assert ends(collision) == [(LEFT, R_COL, 0.0)]


def test_collision_of_an_overruled_proposal_blames_the_executed_action_too() -> None:
    safe, collision = stored(UNSAFE_COLLISION)
    assert len(safe) == 0
    assert collision["a_t"].tolist() == [LEFT, HARD_BRAKE]


def test_a_missed_exit_is_worth_as_little_as_a_collision() -> None:
    safe, collision = stored(decision(missed_exit=True))
    assert (len(safe), len(collision)) == (0, 1)
    assert ends(collision) == [(LEFT, R_COL, 0.0)]


def test_under_a_penalty_an_unsafe_proposal_leads_where_the_executed_action_led() -> None:
    _, collision = stored(UNSAFE, unsafe_penalty=1.5)
    assert len(collision) == 1
    np.testing.assert_array_equal(collision["s_t"][0], BEFORE)
    np.testing.assert_array_equal(collision["s_tp1"][0], AFTER)
    assert ends(collision) == [(LEFT, -1.75, GAMMA)]


@pytest.mark.parametrize(
    "failed", [UNSAFE_COLLISION, decision(HARD_BRAKE, Rule.IN_LANE, missed_exit=True)]
)
def test_under_a_penalty_a_failure_is_terminal_all_the_same(failed: Transition) -> None:
    safe, collision = stored(failed, unsafe_penalty=1.5)
    assert len(safe) == 0
    assert ends(collision) == [(LEFT, R_COL, 0.0), (HARD_BRAKE, R_COL, 0.0)]


def test_speed_is_weighed_in_where_the_reward_is_kept_and_not_in_r_col() -> None:
    # at 20 of at most 30 m/s: 0.6 * 2 / 3
    crash = decision(reward=R_COL, terminated=True)
    safe, collision = stored(decision(), UNSAFE, crash, speed_weight=0.6, unsafe_penalty=1.0)
    assert safe["r_tp1"] == pytest.approx([0.15, 0.15])
    assert collision["r_tp1"] == pytest.approx([-0.85, R_COL])


@pytest.mark.parametrize(
    "buffer",
    [UniformBuffer(N, 10, 0.9), PrioritizedBuffer(N, 10, 0.9, 0.6, 0.4, 1e-6)],
    ids=["uniform", "prioritized"],
)
def test_in_a_single_buffer_an_unsafe_proposal_under_a_penalty_is_no_collision(
    buffer: Buffer,
) -> None:
    writer(buffer, unsafe_penalty=1.5)(UNSAFE)
    ring: Any = buffer
    assert ends(ring.ring.rows[:2]) == [(LEFT, -1.75, GAMMA), (HARD_BRAKE, -0.25, GAMMA)]
    assert buffer.collisions == 0
