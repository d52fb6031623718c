"""Experience buffers: the two of Algorithm 1 of the paper, or one buffer for all transitions."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from drl_av.drivers.network import Float32Array
from drl_av.drivers.policy_file import State
from drl_av.learning.ring import Ring


class Batch(NamedTuple):
    """A minibatch of transitions; its arrays are copies, which the caller may change.

    The states have shape (rows, observation_size), all other arrays (rows,). ``weights`` multiply
    the squared errors; None means 1. ``slots`` are the indices of the rows in a prioritized buffer,
    and None for other buffers.
    """

    s_t: Float32Array
    a_t: NDArray[np.int64]
    r_tp1: Float32Array
    discount: Float32Array
    s_tp1: Float32Array
    weights: Float32Array | None = None
    slots: NDArray[np.int64] | None = None


def batch_of(rows: Float32Array, observation_size: int) -> Batch:
    """Split rows of a ring, shape (rows, 2 * observation_size + 3), into the arrays of a Batch."""
    n = observation_size
    return Batch(
        s_t=rows[:, :n],
        a_t=rows[:, -3].astype(np.int64),
        r_tp1=rows[:, -2],
        discount=rows[:, -1],
        s_tp1=rows[:, n:-3],
    )


def part_of(state: State, prefix: str) -> State:
    """Return the arrays whose names begin with ``prefix``, by the rest of their names."""
    return {k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)}


class Buffer(Protocol):
    """The interface of an experience buffer.

    ``add_safe`` stores a transition, ``add_collision`` stores a terminal transition, and ``sample``
    draws a minibatch. ``collisions`` is the number of terminal transitions; TwoBuffers counts all
    transitions in Buf_C. ``state`` returns a copy of the contents; ``restore`` loads exactly these,
    or raises CheckpointError if they do not fit.
    """

    def __len__(self) -> int: ...
    @property
    def collisions(self) -> int: ...
    def add_safe(self, s_t: Float32Array, a_t: int, r_tp1: float, s_tp1: Float32Array) -> None: ...
    def add_collision(self, s_t: Float32Array, a_t: int, r_col: float) -> None: ...
    def sample(self, batch_size: int, rng: np.random.Generator) -> Batch: ...
    def state(self) -> State: ...
    def restore(self, state: State) -> None: ...

    def add_unsafe(self, s_t: Float32Array, a_t: int, r_tp1: float, s_tp1: Float32Array) -> None:
        """Store an action that the check replaced, like a safe transition (ours).

        ``s_tp1`` is the state after the action that was executed instead.
        """
        self.add_safe(s_t, a_t, r_tp1, s_tp1)

    def anneal(self, progress: float) -> None:
        """Adapt the sampling to the training's ``progress``, from 0 to 1; by default do nothing."""
        return None

    def update_priorities(self, batch: Batch, td_errors: Float32Array) -> None:
        """Set priorities of a batch from its TD errors, shape (rows,); by default do nothing."""
        return None


class TwoBuffers(Buffer):
    """The paper's safe buffer Buf_S and collision buffer Buf_C.

    The share ``collision_fraction`` of each batch comes from Buf_C. If one of the two is empty, the
    whole batch comes from the other one.
    """

    def __init__(
        self,
        observation_size: int,
        safe_capacity: int,
        collision_capacity: int,
        discount: float,
        collision_fraction: float,
    ) -> None:
        self.safe = Ring(safe_capacity, observation_size)
        self.collision = Ring(collision_capacity, observation_size)
        self.discount = discount
        self.collision_fraction = collision_fraction

    def __len__(self) -> int:
        return len(self.safe) + len(self.collision)

    @property
    def collisions(self) -> int:
        """Number of transitions in Buf_C."""
        return len(self.collision)

    def add_safe(self, s_t: Float32Array, a_t: int, r_tp1: float, s_tp1: Float32Array) -> None:
        """Store (s_t, a_t, s_tp1, r_tp1) in Buf_S: Algorithm 1 of the paper, line 11."""
        self.safe.append(s_t, a_t, r_tp1, self.discount, s_tp1)

    def add_collision(self, s_t: Float32Array, a_t: int, r_col: float) -> None:
        """Store a terminal transition, with reward r_col and no next state, in Buf_C.

        Algorithm 1 of the paper, lines 6 and 9.
        """
        self.collision.append(s_t, a_t, r_col, 0.0, 0.0)

    def add_unsafe(self, s_t: Float32Array, a_t: int, r_tp1: float, s_tp1: Float32Array) -> None:
        """Store an action that the check replaced in Buf_C; the row is not terminal (ours)."""
        self.collision.append(s_t, a_t, r_tp1, self.discount, s_tp1)

    def sample(self, batch_size: int, rng: np.random.Generator) -> Batch:
        """Draw ``batch_size`` transitions with replacement: Algorithm 1 of the paper, line 13.

        The rows of Buf_S come first, then those of Buf_C, whose share is ``collision_fraction``. If
        one buffer is empty, all rows are of the other one.

        Raises:
            ValueError: both buffers are empty.
        """
        from_collision = round(batch_size * self.collision_fraction)
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
        rows = drawn[0] if len(drawn) == 1 else np.concatenate(drawn)
        return batch_of(rows, self.safe.observation_size)

    def state(self) -> State:
        """Return the state of both rings; the keys begin with ``safe.`` and ``collision.``."""
        rings = {"safe": self.safe, "collision": self.collision}
        return {f"{name}.{k}": v for name, ring in rings.items() for k, v in ring.state().items()}

    def restore(self, state: State) -> None:
        for name, ring in (("safe", self.safe), ("collision", self.collision)):
            ring.restore(part_of(state, f"{name}."))


class UniformBuffer(Buffer):
    """A single ring for all transitions, which are sampled uniformly."""

    def __init__(self, observation_size: int, capacity: int, discount: float) -> None:
        self.ring = Ring(capacity, observation_size)
        self.discount = discount

    def __len__(self) -> int:
        return len(self.ring)

    @property
    def collisions(self) -> int:
        """Number of stored terminal transitions."""
        return self.ring.endings()

    def add_safe(self, s_t: Float32Array, a_t: int, r_tp1: float, s_tp1: Float32Array) -> None:
        """Store the transition (s_t, a_t, s_tp1, r_tp1), with discount gamma."""
        self.stored(self.ring.append(s_t, a_t, r_tp1, self.discount, s_tp1))

    def add_collision(self, s_t: Float32Array, a_t: int, r_col: float) -> None:
        """Store a terminal transition, with reward r_col, discount 0 and no next state."""
        self.stored(self.ring.append(s_t, a_t, r_col, 0.0, 0.0))

    def stored(self, slot: int) -> None:
        """Handle a new transition, just stored in the row ``slot``; by default do nothing."""

    def sample(self, batch_size: int, rng: np.random.Generator) -> Batch:
        """Draw a minibatch of transitions; raises ValueError if the buffer is empty."""
        return batch_of(self.ring.draw(batch_size, rng), self.ring.observation_size)

    def state(self) -> State:
        return self.ring.state()

    def restore(self, state: State) -> None:
        self.ring.restore(state)
