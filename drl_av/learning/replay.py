"""Experience replay: the two buffers of Algorithm 1 of the paper, or one for all transitions.

A stored transition has its own discount: 0 for a terminal transition, which has the reward r_col,
and gamma for all others.
"""

from abc import ABC, abstractmethod
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drl_av.arrays import Float32Array, IntArray
from drl_av.config import LearningConfig
from drl_av.drivers.policy_file import State
from drl_av.errors import ConfigError

MEMORY = Path("/proc/meminfo")
"""File in which Linux reports the available memory; other systems do not have it."""


@cache
def row_type(observation_size: int) -> np.dtype[np.void]:
    """Return the type of a stored transition, whose fields are float32."""
    return np.dtype(
        [
            ("s_t", np.float32, (observation_size,)),
            ("s_tp1", np.float32, (observation_size,)),
            ("a_t", np.float32),
            ("r_tp1", np.float32),
            ("discount", np.float32),
        ]
    )


class Batch(NamedTuple):
    """A minibatch of transitions; its arrays are copies, which the caller may change.

    The states have shape (rows, observation_size), all other arrays (rows,). ``weights`` multiply
    the squared errors; None means 1. ``slots`` are the indices of the rows in a prioritized buffer,
    and None for other buffers.
    """

    s_t: Float32Array
    a_t: IntArray
    r_tp1: Float32Array
    discount: Float32Array
    s_tp1: Float32Array
    weights: Float32Array | None = None
    slots: IntArray | None = None


def batch_of(numbers: Float32Array, observation_size: int) -> Batch:
    """Return the transitions in ``numbers``, which has a row for each, as a Batch."""
    rows = numbers.view(row_type(observation_size))[:, 0]
    return Batch(
        rows["s_t"], rows["a_t"].astype(np.int64), rows["r_tp1"], rows["discount"], rows["s_tp1"]
    )


def require_memory(rows: int, observation_size: int) -> None:
    """Raise ConfigError if ``rows`` transitions do not fit in the available memory (Linux only)."""
    needed = rows * row_type(observation_size).itemsize
    try:
        words = MEMORY.read_text(encoding="ascii").split()
        available = 1024 * int(words[words.index("MemAvailable:") + 1])
    except (OSError, ValueError):
        return
    if needed > available:
        raise ConfigError(
            f"A buffer of {rows} rows needs {needed / 2**30:.1f} GiB of memory, but "
            f"{available / 2**30:.1f} GiB are available: lower learning.safe_capacity and "
            "learning.collision_capacity."
        )


class Ring:
    """A ring buffer that holds the newest ``capacity`` transitions.

    The system allocates memory as rows are written.

    Raises:
        ConfigError: the memory of this machine cannot hold so many rows.
    """

    def __init__(self, capacity: int, observation_size: int) -> None:
        self.observation_size, kind = observation_size, row_type(observation_size)
        try:
            self.rows: NDArray[np.void] = np.empty(capacity, kind)
            """The transitions, shape (capacity,), with the fields of ``row_type``."""
        except MemoryError as error:
            raise ConfigError(
                f"The memory of this machine cannot hold a buffer of {capacity} rows: lower "
                "learning.safe_capacity and learning.collision_capacity."
            ) from error
        self.numbers: Float32Array = self.rows.view(np.float32).reshape(capacity, -1)
        """The memory of ``rows``, shape (capacity, numbers of a row); numpy copies it faster."""
        self.filled = 0
        self.next_slot = 0

    def __len__(self) -> int:
        return self.filled

    def append(
        self,
        s_t: Float32Array,
        a_t: int,
        r_tp1: float,
        discount: float,
        s_tp1: Float32Array | float,
    ) -> int:
        """Store a transition, in a full ring in place of the oldest one; return its row index.

        ``discount`` multiplies the value of ``s_tp1`` in the target; it is 0 for a terminal
        transition, whose ``s_tp1`` has no effect.
        """
        slot = self.next_slot
        self.rows[slot] = s_t, s_tp1, a_t, r_tp1, discount
        self.next_slot = (slot + 1) % len(self.rows)
        self.filled = max(self.filled, slot + 1)
        return slot

    def draw(self, count: int, rng: np.random.Generator) -> Float32Array:
        """Draw stored rows uniformly with replacement; return a copy, shape (count, numbers)."""
        return self.numbers.take(rng.integers(0, self.filled, count), axis=0)

    def endings(self) -> int:
        """Return the number of stored terminal rows, which have discount 0."""
        return self.filled - int(np.count_nonzero(self.rows["discount"][: self.filled]))

    def state(self) -> State:
        """Return a copy of the stored rows, and the index of the row that is written next."""
        return {"rows": self.numbers[: self.filled].copy(), "next_slot": np.array(self.next_slot)}

    def restore(self, state: State) -> None:
        """Set the ring to exactly the state that ``state`` returned.

        Raises:
            LookupError, TypeError, ValueError: the rows do not fit a ring of this capacity and
                observation size; the ring stays as it was.
        """
        rows, slot = state["rows"], int(state["next_slot"])
        if not 0 <= slot < len(self.rows) or len(rows) not in (slot, len(self.rows)):
            raise ValueError(f"{len(rows)} rows for {len(self.rows)}")
        np.copyto(self.numbers[: len(rows)], rows, casting="no")
        self.filled, self.next_slot = len(rows), slot


def part_of(state: State, prefix: str) -> State:
    """Return the arrays whose names begin with ``prefix``, by the rest of their names."""
    return {k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)}


class Buffer(ABC):
    """An experience buffer: a ring of terminal transitions, and one of all others.

    Both may be the same ring. ``sample`` draws a minibatch, and raises ValueError if the buffer is
    empty. ``state`` returns a copy of the contents; ``restore`` loads exactly these, or raises
    LookupError, TypeError or ValueError if they do not fit.
    """

    safe: Ring
    collision: Ring
    discount: float

    @property
    def collisions(self) -> int:
        """Number of stored terminal transitions."""
        return self.collision.endings()

    def add_safe(self, s_t: Float32Array, a_t: int, r_tp1: float, s_tp1: Float32Array) -> None:
        """Store (s_t, a_t, s_tp1, r_tp1): Algorithm 1 of the paper, line 11."""
        self.stored(self.safe.append(s_t, a_t, r_tp1, self.discount, s_tp1))

    def add_collision(self, s_t: Float32Array, a_t: int, r_col: float) -> None:
        """Store a terminal transition, with reward r_col, discount 0 and no next state.

        Algorithm 1 of the paper, lines 6 and 9.
        """
        self.stored(self.collision.append(s_t, a_t, r_col, 0.0, 0.0))

    def stored(self, slot: int) -> None:
        """Handle a new transition, just stored in the row ``slot``; by default do nothing."""
        return None

    @abstractmethod
    def sample(self, batch_size: int, rng: np.random.Generator) -> Batch: ...
    @abstractmethod
    def state(self) -> State: ...
    @abstractmethod
    def restore(self, state: State) -> None: ...

    def anneal(self, progress: float) -> None:
        """Adapt the sampling to the training's ``progress``, from 0 to 1; by default do nothing."""
        return None

    def update_priorities(self, batch: Batch, td_errors: Float32Array) -> None:
        """Set priorities of a batch from its TD errors, shape (rows,); by default do nothing."""
        return None


class TwoBuffers(Buffer):
    """The paper's safe buffer Buf_S and collision buffer Buf_C.

    The share ``collision_fraction`` of each batch, at least one row if it is above 0, comes from
    Buf_C. If one of the two is empty, the whole batch comes from the other one.
    """

    def __init__(self, observation_size: int, config: LearningConfig) -> None:
        self.safe = Ring(config.safe_capacity, observation_size)
        self.collision = Ring(config.collision_capacity, observation_size)
        self.discount, self.collision_fraction = config.discount, config.collision_fraction

    def sample(self, batch_size: int, rng: np.random.Generator) -> Batch:
        """Draw ``batch_size`` transitions with replacement: Algorithm 1 of the paper, line 13.

        The rows of Buf_S come first, then those of Buf_C, whose share is ``collision_fraction``. If
        one buffer is empty, all rows are of the other one.

        Raises:
            ValueError: both buffers are empty.
        """
        rounded = round(batch_size * self.collision_fraction)
        from_collision = max(rounded, 1 if self.collision_fraction else 0)
        if not self.collision:
            from_collision = 0
        elif not self.safe:
            from_collision = batch_size
        drawn = [
            ring.draw(count, rng)
            for ring, count in (
                (self.safe, batch_size - from_collision),
                (self.collision, from_collision),
            )
            if count
        ]
        numbers = drawn[0] if len(drawn) == 1 else np.concatenate(drawn)
        return batch_of(numbers, self.safe.observation_size)

    def state(self) -> State:
        """Return the state of both rings; the keys begin with ``safe.`` and ``collision.``."""
        rings = {"safe": self.safe, "collision": self.collision}
        return {f"{name}.{k}": v for name, ring in rings.items() for k, v in ring.state().items()}

    def restore(self, state: State) -> None:
        for name, ring in (("safe", self.safe), ("collision", self.collision)):
            ring.restore(part_of(state, f"{name}."))


class UniformBuffer(Buffer):
    """A single ring for all transitions, which are sampled uniformly."""

    def __init__(self, observation_size: int, config: LearningConfig) -> None:
        self.ring = Ring(config.safe_capacity + config.collision_capacity, observation_size)
        self.safe = self.collision = self.ring
        self.discount = config.discount

    def sample(self, batch_size: int, rng: np.random.Generator) -> Batch:
        return batch_of(self.ring.draw(batch_size, rng), self.ring.observation_size)

    def state(self) -> State:
        return self.ring.state()

    def restore(self, state: State) -> None:
        self.ring.restore(state)
