"""Makes background vehicles brake hard at random, without a visible reason (ours)."""

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.drivers.driver import Decisions


class HardBraking:
    """Replaces the decisions of vehicles that brake hard.

    At each decision a separate random generator draws which vehicles begin to brake; they brake
    for ``traffic.hard_brake_s``. ``n`` is the number of rows in a snapshot.
    """

    def __init__(self, seed: int, n: int, config: Config) -> None:
        self._rng = np.random.default_rng([seed, 4])
        self._left = np.zeros(n, dtype=np.intp)
        self._config = config

    def __call__(self, decisions: Decisions, rows: npt.NDArray[np.intp]) -> Decisions:
        """Return the decisions; a vehicle that brakes hard keeps its lane.

        ``rows``, shape (R,), holds each vehicle's row index in the snapshot arrays.
        """
        traffic, timing = self._config.traffic, self._config.simulation
        chance = traffic.hard_brakes_per_s * timing.decision_interval_s
        begins = (self._rng.random(len(rows)) < chance) & (self._left[rows] == 0)
        left = np.where(begins, traffic.hard_brake_s, self._left[rows])
        self._left[rows] = np.maximum(left - 1, 0)
        braking_m_s2 = self._config.finite_state.braking_m_s2
        return Decisions(
            np.where(left > 0, -braking_m_s2, decisions.acceleration_m_s2),
            np.where(left > 0, 0, decisions.side),
        )
