from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drl_av.config import LearningConfig
from drl_av.errors import ConfigError
from drl_av.learning.algorithm_1 import make_buffer
from drl_av.learning.replay import Ring, TwoBuffers, UniformBuffer

HUNDRED = LearningConfig(safe_capacity=60, collision_capacity=40)


def observation(value: float) -> np.ndarray:
    return np.full(2, value, np.float32)


def two_buffers(safe: int, collision: int, fraction: float = 0.5) -> TwoBuffers:
    capacities = {"safe_capacity": 100, "collision_capacity": 50}
    buffer = TwoBuffers(2, LearningConfig(**capacities, collision_fraction=fraction))
    for i in range(safe):
        buffer.add_safe(observation(i), i % 12, 0.1 * i, observation(i + 1))
    for i in range(collision):
        buffer.add_collision(observation(-i), i % 12, -5.0)
    return buffer


def test_a_batch_of_64_has_32_rows_of_each_buffer_however_rare_collisions_are():
    batch = two_buffers(90, 1).sample(64, np.random.default_rng(0))
    assert np.array_equal(batch.discount, np.float32([0.9] * 32 + [0.0] * 32))
    assert (batch.r_tp1[32:] == -5.0).all()
    assert (batch.r_tp1[:32] >= 0.0).all()


def test_the_share_of_collisions_is_rounded_to_the_nearest_number_of_rows():
    drawn = [
        (two_buffers(9, 9, fraction).sample(10, np.random.default_rng(0)).discount == 0.0).sum()
        for fraction in (0.33, 0.37, 0.01, 0.0)
    ]
    assert drawn == [3, 4, 1, 0]


@pytest.mark.parametrize(("safe", "collision", "expected"), [(5, 0, 0), (0, 5, 64), (5, 5, 64)])
def test_the_other_buffer_stands_in_for_an_empty_one(safe, collision, expected):
    fraction = 1.0 if safe and collision else 0.5
    batch = two_buffers(safe, collision, fraction).sample(64, np.random.default_rng(0))
    assert (batch.discount == 0.0).sum() == expected
    assert len(batch.a_t) == 64


def test_a_row_comes_back_as_it_went_in():
    buffer = TwoBuffers(2, LearningConfig(safe_capacity=4, collision_capacity=4))
    buffer.add_safe(np.float32([1, 2]), 11, -0.25, np.float32([3, 4]))
    batch = buffer.sample(2, np.random.default_rng(0))
    assert batch.s_t.tolist() == [[1, 2]] * 2
    assert batch.s_tp1.tolist() == [[3, 4]] * 2
    assert batch.a_t.tolist() == [11, 11]
    assert batch.a_t.dtype == np.int64
    assert batch.r_tp1.tolist() == [-0.25] * 2
    assert batch.weights is None


def test_uniform_buffer_takes_collisions_as_often_as_they_are():
    buffer = UniformBuffer(2, LearningConfig(safe_capacity=900, collision_capacity=100))
    for i in range(900):
        buffer.add_safe(observation(i), 0, 0.0, observation(i))
    for _ in range(100):
        buffer.add_collision(observation(0), 0, -5.0)
    batch = buffer.sample(10_000, np.random.default_rng(0))
    assert (batch.discount == 0.0).mean() == pytest.approx(0.1, abs=0.01)


def test_a_collision_buffer_that_is_too_small_for_learning_to_start_is_refused():
    small = {"collisions_to_start": 51, "collision_capacity": 50}
    with pytest.raises(ConfigError, match="is 51, but the buffer of collisions holds 50"):
        make_buffer(LearningConfig(**small), 2)
    one = small | {"replay": "uniform", "safe_capacity": 25, "collision_capacity": 25}
    with pytest.raises(ConfigError, match="is 51, but the buffer of collisions holds 50"):
        make_buffer(LearningConfig(**one), 2)
    with pytest.raises(ConfigError, match=r"above 0, or learning\.replay to two-buffer"):
        make_buffer(LearningConfig(**small, replay="uniform", discount=0.0), 2)
    make_buffer(LearningConfig(**small, replay="uniform"), 2)


def test_config_names_the_buffer():
    config = LearningConfig(safe_capacity=7, collision_capacity=3)
    two = make_buffer(config, 27)
    assert isinstance(two, TwoBuffers)
    assert (len(two.safe.rows), len(two.collision.rows)) == (7, 3)
    one = make_buffer(LearningConfig(replay="uniform", safe_capacity=7, collision_capacity=3), 27)
    assert isinstance(one, UniformBuffer)
    assert len(one.ring.rows) == 10


@given(capacity=st.integers(1, 20), count=st.integers(0, 60))
def test_a_ring_holds_exactly_the_newest(capacity, count):
    ring = Ring(capacity, 1)
    for i in range(count):
        ring.append(np.float32([i]), i, i, 0.9, 0.0)
    assert sorted(ring.rows["a_t"][: len(ring)]) == list(range(max(0, count - capacity), count))


@given(
    safe=st.integers(0, 120), collision=st.integers(0, 70), more=st.integers(0, 120), data=st.data()
)
def test_a_restored_buffer_continues_bit_for_bit(safe, collision, more, data):
    first = two_buffers(safe, collision)
    second = two_buffers(data.draw(st.integers(0, 3)), 1)
    second.restore(first.state())
    for buffer in (first, second):
        for i in range(more):
            buffer.add_safe(observation(i / 7), 1, i / 3, observation(i))
    for name, expected in first.state().items():
        assert second.state()[name].tobytes() == expected.tobytes()
    if first.safe or first.collision:
        ours, theirs = (b.sample(16, np.random.default_rng(5)) for b in (first, second))
        assert all(np.array_equal(x, y) for x, y in zip(ours[:5], theirs[:5], strict=True))


def test_state_is_a_copy_that_later_rows_do_not_touch():
    buffer = two_buffers(100, 0)
    state = buffer.state()
    before = state["safe.rows"].copy()
    buffer.add_safe(observation(9), 0, 0.0, observation(9))
    assert np.array_equal(state["safe.rows"], before)


@pytest.mark.parametrize(
    "other",
    [
        UniformBuffer(3, HUNDRED).state(),
        {"rows": np.zeros((200, 7), np.float32), "next_slot": np.array(0)},
        {"rows": np.zeros((5, 7), np.float32), "next_slot": np.array(2)},
        {"rows": np.zeros((5, 7)), "next_slot": np.array(5)},
        {},
    ],
    ids=["too narrow", "too long", "slot past a hole", "float64", "missing"],
)
def test_experience_that_does_not_fit_is_refused(other):
    if len(other.get("rows", [])) == 0 and other:
        other["rows"] = np.zeros((0, 9), np.float32)
    with pytest.raises((KeyError, TypeError, ValueError)):
        UniformBuffer(2, HUNDRED).restore(other)


def test_a_capacity_that_no_memory_holds_is_one_sentence() -> None:
    with pytest.raises(ConfigError, match=r"buffer of 1000000000000000 rows: lower"):
        Ring(10**15, 27)


def test_a_buffer_larger_than_the_available_memory_is_refused_before_it_is_allocated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # 57 numbers of 4 bytes a row: 11,000 rows are 2.39 MiB
    file = tmp_path / "meminfo"
    monkeypatch.setattr("drl_av.learning.replay.MEMORY", file)
    monkeypatch.setattr(Ring, "__init__", lambda *_: pytest.fail("allocated"))
    file.write_text("MemTotal: 9000000 kB\nMemAvailable: 2048 kB\n")
    for replay in ("two-buffer", "uniform", "prioritized"):
        config = LearningConfig(replay=replay, safe_capacity=10_000, collision_capacity=1_000)
        with pytest.raises(ConfigError, match=r"buffer of 11000 rows needs .* GiB of memory, but"):
            make_buffer(config, 27)
    file.unlink()  # where no system says what is available, it is allocated
    with pytest.raises(pytest.fail.Exception, match="allocated"):
        make_buffer(LearningConfig(), 27)
