"""The ring buffer in which an experience buffer stores its transitions, one in each row.

A row contains the discount of its transition: 0 for a terminal transition, which has the reward
r_col, and gamma for all others.
"""

from pathlib import Path

import numpy as np

from drl_av.drivers.network import Float32Array
from drl_av.drivers.policy_file import State
from drl_av.driving.actions import ACTIONS
from drl_av.errors import CheckpointError, ConfigError

MEMORY = Path("/proc/meminfo")
"""File in which Linux reports the available memory; other systems do not have it."""


def require_memory(rows: int, observation_size: int) -> None:
    """Raise ConfigError if ``rows`` transitions do not fit in the available memory (Linux only)."""
    needed = rows * row_width(observation_size) * np.dtype(np.float32).itemsize
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


def row_width(observation_size: int) -> int:
    """Return the number of float32 values in the row of a transition."""
    return 2 * observation_size + 3


class Ring:
    """A ring buffer that holds the newest ``capacity`` transitions.

    A transition is one float32 row: s_t, s_tp1, a_t, r_tp1, discount. The system allocates memory
    as rows are written.

    Raises:
        ConfigError: the memory of this machine cannot hold so many rows.
    """

    def __init__(self, capacity: int, observation_size: int) -> None:
        self.observation_size = observation_size
        try:
            self.rows: Float32Array = np.empty((capacity, row_width(observation_size)), np.float32)
        except MemoryError as error:
            raise ConfigError(
                f"The memory of this machine cannot hold a buffer of {capacity} rows: lower "
                "learning.safe_capacity and learning.collision_capacity."
            ) from error
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
        slot, n = self.next_slot, self.observation_size
        row = self.rows[slot]
        row[:n] = s_t
        row[n:-3] = s_tp1
        row[-3], row[-2], row[-1] = a_t, r_tp1, discount
        self.next_slot = (slot + 1) % len(self.rows)
        self.filled = max(self.filled, slot + 1)
        return slot

    def draw(self, count: int, rng: np.random.Generator) -> Float32Array:
        """Draw ``count`` stored rows uniformly with replacement; return a copy of them."""
        drawn: Float32Array = self.rows.take(rng.integers(0, self.filled, count), axis=0)
        return drawn

    def endings(self) -> int:
        """Return the number of stored terminal rows, which have discount 0."""
        return self.filled - int(np.count_nonzero(self.rows[: self.filled, -1]))

    def state(self) -> State:
        """Return a copy of the stored rows, and the index of the row that is written next."""
        return {"rows": self.rows[: self.filled].copy(), "next_slot": np.array(self.next_slot)}

    def restore(self, state: State) -> None:
        """Set the ring to exactly the state that ``state`` returned.

        Raises:
            CheckpointError: the rows do not fit a ring of this capacity and observation size, or
                are no transitions.
        """
        rows = state.get("rows", np.empty(0))
        next_slot = state.get("next_slot", np.empty(0))
        capacity, width = self.rows.shape
        fits = (
            rows.dtype == np.float32
            and rows.shape[1:] == (width,)
            and next_slot.shape == ()
            and 0 <= next_slot < capacity
            and (len(rows) == capacity or len(rows) == next_slot)
        )
        if not fits:
            raise CheckpointError(
                f"The stored experience does not fit a buffer of {capacity} rows of {width} "
                "numbers: continue with the configuration the run was started with."
            )
        if not _are_transitions(rows):
            raise CheckpointError(
                "The stored experience holds rows that are no transitions: a number is not finite, "
                "an action is none of the 12, or a discount is not from 0 to 1; take an older "
                "copy, or begin a new run."
            )
        self.filled, self.next_slot = len(rows), int(next_slot)
        self.rows[: self.filled] = rows


def _are_transitions(rows: Float32Array) -> bool:
    """Whether all numbers are finite, and actions and discounts within their ranges."""
    a_t, discount = rows[:, -3], rows[:, -1]
    return bool(
        np.isfinite(rows).all()
        and np.isin(a_t, range(len(ACTIONS))).all()
        and ((discount >= 0) & (discount <= 1)).all()
    )
