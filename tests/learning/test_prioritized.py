import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drl_av.config import LearningConfig
from drl_av.driving.mirror import MIRROR
from drl_av.learning.algorithm_1 import make_buffer, mirror_half
from drl_av.learning.prioritized import PrioritizedBuffer, SumTree, importance_weights


def observation(value: float, size: int = 2) -> np.ndarray:
    return np.full(size, value, np.float32)


def prioritized(
    rows: int = 0, capacity: int = 200, exponent: float = 0.5, size: int = 2
) -> PrioritizedBuffer:
    capacities = {"safe_capacity": capacity - 1, "collision_capacity": 1}
    buffer = PrioritizedBuffer(size, LearningConfig(**capacities, priority_exponent=exponent))
    for i in range(rows):
        buffer.add_safe(observation(i, size), i % 12, -0.5, observation(i + 1, size))
    return buffer


def learn(buffer: PrioritizedBuffer, errors: dict[int, float]) -> None:
    """Tell the buffer the TD errors of some of its slots."""
    batch = buffer.sample(len(errors), np.random.default_rng(0))
    batch = batch._replace(slots=np.array(list(errors)))
    buffer.update_priorities(batch, np.array(list(errors.values()), np.float32))


def test_fractions_fall_into_slots_laid_end_to_end():
    tree = SumTree(200)
    tree.set(np.array([3, 64, 199]), np.array([1.0, 2.0, 1.0]))
    # Edges at 0, 1, 3 and 4 of 4: a slot has its left edge, not its right one.
    slots, probability = tree.find(np.array([0.0, 0.24, 0.25, 0.74, 0.75, 1 - 1e-12]))
    assert slots.tolist() == [3, 3, 64, 64, 199, 199]
    assert probability.tolist() == [0.25, 0.25, 0.5, 0.5, 0.25, 0.25]


updates = st.lists(
    st.lists(st.tuples(st.integers(0, 149), st.integers(0, 2**20)), min_size=1, max_size=9),
    min_size=1,
    max_size=9,
)


@given(updates=updates, fractions=st.lists(st.floats(0, 1, exclude_max=True), min_size=1))
def test_a_tree_agrees_exactly_with_a_plain_cumulative_sum(updates, fractions):
    # Whole numbers add up exactly, so that any slip shows, and rounding does not.
    tree, plain = SumTree(150), np.zeros(150)
    tree.set(np.array([149]), 1.0)
    plain[149] = 1.0
    for update in updates:
        slots, weights = (np.array(column) for column in zip(*update, strict=True))
        tree.set(slots, weights.astype(float))
        for slot, weight in update:
            plain[slot] = weight
    if not plain.any():
        return
    found, probability = tree.find(np.array(fractions))
    values = np.minimum(np.array(fractions) * plain.sum(), np.nextafter(plain.sum(), 0))
    assert found.tolist() == plain.cumsum().searchsorted(values, side="right").tolist()
    assert probability.tolist() == (plain[found] / plain.sum()).tolist()


@given(
    weights=st.lists(st.one_of(st.just(0.0), st.floats(1e-4, 1e4)), min_size=1, max_size=150),
    fractions=st.lists(
        st.one_of(st.floats(0, 1, exclude_max=True), st.just(1 - 2**-53)), min_size=1
    ),
)
def test_rounding_never_finds_a_slot_without_weight_or_far_from_its_place(weights, fractions):
    if not any(weights):
        return
    tree, plain = SumTree(150), np.array(weights)
    tree.fill(plain)
    found, _ = tree.find(np.array(fractions))
    assert (plain[found] > 0).all()
    ends, values = plain.cumsum(), np.array(fractions) * plain.sum()
    slack = 1e-12 * plain.sum()
    assert (ends[found] - plain[found] <= values + slack).all()
    assert (values <= ends[found] + slack).all()


def test_importance_weights_by_hand():
    # N = 4, beta = 1/2: (4/2)^-1/2, (4/4)^-1/2 and (4/16)^-1/2 = 2, which is the greatest.
    weights = importance_weights(np.array([1 / 2, 1 / 4, 1 / 16]), 4, 0.5)
    assert weights.tolist() == pytest.approx([math.sqrt(0.5) / 2, 0.5, 1.0])
    assert weights.dtype == np.float32


def test_rows_are_drawn_as_often_as_a_naive_sampler_draws_them():
    buffer = prioritized(4)
    learn(buffer, {0: 1.0, 1: -4.0, 2: 9.0, 3: 16.0})
    # alpha = 1/2: the roots 1, 2, 3 and 4 of 10; the errors themselves would be of 30.
    rng = np.random.default_rng(1)
    counts = np.zeros(4)
    for _ in range(2_000):
        counts += np.bincount(buffer.sample(5, rng).slots, minlength=4)
    p = np.sqrt(np.abs([1.0, -4.0, 9.0, 16.0]) + 1e-6)
    naive = np.bincount(np.random.default_rng(2).choice(4, 10_000, p=p / p.sum()), minlength=4)
    assert counts / 10_000 == pytest.approx([0.1, 0.2, 0.3, 0.4], abs=0.015)
    assert counts / 10_000 == pytest.approx(naive / 10_000, abs=0.02)


def test_a_batch_has_one_row_of_each_equal_share():
    buffer = prioritized(100)
    for seed in range(20):
        slots = buffer.sample(10, np.random.default_rng(seed)).slots
        assert (slots // 10).tolist() == list(range(10))


def test_a_new_row_has_the_greatest_priority_so_far_even_of_one_long_forgotten():
    buffer = prioritized(3, capacity=3)
    assert buffer.tree.weights.tolist() == [1.0, 1.0, 1.0]
    learn(buffer, {0: 100.0, 1: 0.25})
    learn(buffer, {0: 0.0})
    assert buffer.tree.weights == pytest.approx([1e-3, 0.5, 1.0], rel=1e-5)
    buffer.add_collision(observation(0), 5, -3.0)
    buffer.add_safe(observation(0), 5, -0.5, observation(0))
    assert buffer.tree.weights == pytest.approx([10.0, 10.0, 1.0])
    assert buffer.collisions == 1


def test_a_row_comes_with_its_own_slot_and_the_weight_of_its_priority():
    buffer = prioritized(2, exponent=1.0)
    buffer.add_collision(observation(-1), 7, -3.0)
    learn(buffer, {0: 1.0, 1: 1.0, 2: 6.0})
    buffer.anneal(0.5)
    batch = buffer.sample(64, np.random.default_rng(0))
    assert np.array_equal(batch.s_t[:, 0], np.where(batch.slots == 2, -1, batch.slots))
    assert np.array_equal(
        batch.discount, np.where(batch.slots == 2, np.float32(0), np.float32(0.9))
    )
    # beta = 0.4 + 0.6 / 2 = 0.7; six times as often, 6^-0.7 the weight.
    assert batch.weights[batch.slots == 2] == pytest.approx(6**-0.7, rel=1e-5)
    assert batch.weights[batch.slots != 2] == pytest.approx(1.0)


def test_priority_exponent_zero_is_uniform():
    buffer = prioritized(10, exponent=0.0)
    learn(buffer, {0: 1e6, 1: 0.0})
    batch = buffer.sample(10, np.random.default_rng(0))
    assert batch.slots.tolist() == list(range(10))
    assert batch.weights.tolist() == [1.0] * 10


def test_a_mirrored_batch_keeps_slots_and_weights():
    buffer = prioritized(50, size=27)
    learn(buffer, {7: 3.0})
    batch = buffer.sample(8, np.random.default_rng(0))
    slots, weights = batch.slots.copy(), batch.weights.copy()
    mirrored = mirror_half(batch, MIRROR)
    assert np.array_equal(mirrored.slots, slots)
    assert np.array_equal(mirrored.weights, weights)


def test_an_empty_buffer_has_nothing_to_sample():
    with pytest.raises(ValueError, match="no rows"):
        prioritized().sample(4, np.random.default_rng(0))


def test_config_names_it():
    config = LearningConfig(
        replay="prioritized",
        safe_capacity=7,
        collision_capacity=3,
        priority_exponent=0.3,
        importance_exponent_start=0.2,
        priority_floor=0.5,
    )
    buffer = make_buffer(config, 2)
    assert isinstance(buffer, PrioritizedBuffer)
    assert len(buffer.ring.rows) == 10
    found = buffer.priority_exponent, buffer.importance_exponent, buffer.priority_floor
    assert found == (0.3, 0.2, 0.5)


@given(rows=st.integers(0, 150), learnt=st.integers(0, 5), more=st.integers(0, 60))
def test_a_restored_buffer_continues_bit_for_bit(rows, learnt, more):
    first, second = prioritized(rows, capacity=130, exponent=0.6), prioritized(3, capacity=130)
    second.priority_exponent = 0.6
    rng = np.random.default_rng(rows)

    def go_on(buffer: PrioritizedBuffer, rng: np.random.Generator) -> list[np.ndarray]:
        batch = buffer.sample(16, rng)
        buffer.update_priorities(batch, rng.standard_normal(16).astype(np.float32))
        return [part.copy() for part in batch]

    for _ in range(learnt if rows else 0):
        go_on(first, rng)
    second.restore(first.state())
    twins = []
    for buffer in (first, second):
        rng = np.random.default_rng(5)
        for i in range(more):
            buffer.add_safe(observation(i / 7), 1, i / 3, observation(i))
        drawn = [part for _ in range(4) for part in go_on(buffer, rng)] if buffer.ring else []
        state = [buffer.state()[name] for name in sorted(buffer.state())]
        twins.append([array.tobytes() for array in (*drawn, *state)])
    assert twins[0] == twins[1]


def test_state_is_a_copy_that_later_learning_does_not_touch():
    buffer = prioritized(5)
    state = buffer.state()
    learn(buffer, {0: 9.0})
    assert state["priorities"].tolist() == [1.0] * 5


@pytest.mark.parametrize(
    "spoilt",
    [
        {"priorities": np.ones(4)},
        {"priorities": np.zeros(5)},
        {"priorities": np.full(5, np.nan)},
        {"priorities": np.full(5, 2.0)},
        {"greatest": np.array(np.inf)},
        {"priorities": np.full(5, 1e308), "greatest": np.array(1e308)},
        {"rows": np.zeros((5, 9), np.float32)},
    ],
    ids=["too few", "none", "nan", "above the greatest", "inf", "infinite sum", "too wide"],
)
def test_priorities_that_do_not_fit_are_refused_and_change_nothing(spoilt):
    buffer = prioritized(3)
    before = {name: array.tobytes() for name, array in buffer.state().items()}
    with pytest.raises(ValueError, match=r"do not fit the rows|broadcast"):
        buffer.restore(prioritized(5).state() | spoilt)
    with pytest.raises(KeyError):
        buffer.restore({})
    assert {name: array.tobytes() for name, array in buffer.state().items()} == before
