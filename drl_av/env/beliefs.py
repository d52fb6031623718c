"""What a driver believes of the others: how each wants to drive, from its speeds so far (ours)."""

from typing import NamedTuple

import numpy as np

from drl_av.arrays import BoolArray, FloatArray, IntArray
from drl_av.config import Config
from drl_av.drivers.background.traffic import ORDER
from drl_av.env.vector import TwinVectorEnv
from drl_av.road.snapshot import EGO, Snapshot
from drl_av.scenarios.folder import Scenario
from drl_av.simulation.population import DriverModel, Population, draw_driver_models, draw_drivers
from drl_av.twin.lane_speeds import RIGHT_RELUCTANCE
from drl_av.twin.traffic import GAIN
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    DESIRED_M_S,
    DRIVER_COUNT,
    DRIVERS,
    EXPECTED_M_S,
    HEADWAY_S,
    KEEPS_DISTANCE,
    MODEL,
    ON_REQUEST_ONLY,
    THRESHOLD_LEFT,
    THRESHOLD_RIGHT,
    WISH_M_S2,
)

GUESSES = 128
SPREAD_M_S, DOUBT = 0.1, 0.02
"""How far a good prediction of a speed a second later may be off; and the likelihood of any other
speed, such as after a random lane change, relative to that of an exact prediction."""
EXACT_M_S, EXPLAINED = 0.01, 0.05
"""How exactly a guess is moved to a speed; and the weight that those which predict it well must
have together, or none is moved."""
TOO_FEW, SPREADING, LEAST_SPREAD = 0.5, 0.1, 0.02
"""The share of guesses below which so few weigh much that all are drawn anew. Then they are spread
by ``SPREADING`` of their standard deviation, at least by ``LEAST_SPREAD`` of the traffic's."""
NORMAL_QUARTILES = 1.349
"""The distance of the quartiles of a normal distribution, in standard deviations."""
PLACES = np.array([ORDER.index(model) if model in ORDER else len(ORDER) for model in DriverModel])
"""For each ``DriverModel``, its place in the order in which our own drivers decide."""


class Guesses(NamedTuple):
    """What is believed of one vehicle."""

    weights: FloatArray
    """Shape (GUESSES,); their sum is 1."""
    logs: FloatArray
    """Logarithms of the desired speed, m/s, the headway, s, and the acceleration, m/s2, shape
    (GUESSES, 3)."""
    rows: IntArray
    """The row of each guess in the drawn population, which has what is not moved: the driver's
    model and its eagerness to change lanes."""


class Beliefs:
    """Keeps ``GUESSES`` guesses of a driver's parameters for each vehicle, by its name.

    They begin as draws from the settings ``traffic``. When a speed comes in, guesses that nearly
    predicted it are moved towards where they would have, as far as parameters and predictions go
    together among these (the ensemble Kalman filter, Evensen 1994; distant guesses may follow
    another rule of driving and stay), and all are weighed by how well they predicted it. When few
    weigh much, all are drawn anew from these, and spread (the particle filter, Gordon et al. 1993).
    """

    def __init__(self, rng: np.random.Generator, scenario: Scenario, config: Config) -> None:
        self._car_m, traffic = scenario.vehicle_types.traffic.length_m, config.traffic
        self._truck_m, self._rng = traffic.truck_length_m, rng
        self._drawn = draw_drivers(rng, GUESSES, config)
        models = draw_driver_models(int(rng.integers(2**31)), GUESSES + 1, traffic)
        self._models = models[1:].astype(np.int64)
        drawn = self._drawn.desired_speed_m_s, self._drawn.headway_s, self._drawn.acceleration_m_s2
        self._logs = np.log(np.stack(drawn, axis=1))
        self._bounds = self._logs.min(axis=0), self._logs.max(axis=0)
        low, high = np.quantile(self._logs, (0.25, 0.75), axis=0)
        self._least = LEAST_SPREAD * (high - low) / NORMAL_QUARTILES
        self._of: dict[str, Guesses] = {}

    def population(self, shot: Snapshot) -> Population:
        """Return the vehicles of a snapshot, all with the parameters of the first guess."""
        population = self._drawn.rows([0] * len(shot.ids))
        population.is_truck[:] = self._is_truck(shot.length_m)
        population.is_truck[EGO] = False
        return population

    def see(self, shot: Snapshot) -> None:
        """Take in the vehicles that were never seen before.

        A truck has the guesses of trucks, if any were drawn.
        """
        for name, is_truck in zip(shot.ids, self._is_truck(shot.length_m).tolist(), strict=True):
            if name not in self._of:
                fits = np.flatnonzero(self._drawn.is_truck == is_truck)
                rows = np.resize(fits if len(fits) else np.arange(GUESSES), GUESSES)
                logs, weights = self._spread(self._logs[rows]), np.full(GUESSES, 1 / GUESSES)
                self._of[name] = Guesses(weights, logs, rows)

    def learn(self, name: str, predicted_m_s: FloatArray, speed_m_s: float) -> None:
        """Move and weigh the guesses by what they predicted, shape (GUESSES,), and what came."""
        weights, logs, rows = self._of[name]
        error = predicted_m_s - speed_m_s
        likely = np.exp(-0.5 * (error / SPREAD_M_S) ** 2)
        if (near := weights * likely).sum() > EXPLAINED:
            near /= near.sum()
            from_mean = predicted_m_s - near @ predicted_m_s
            variance = near @ from_mean**2 + EXACT_M_S**2
            slope = (near * from_mean) @ (logs - near @ logs) / variance
            wanted = self._rng.normal(-error, EXACT_M_S) * likely
            logs = np.clip(logs + wanted[:, np.newaxis] * slope, *self._bounds)
        weights = weights * (likely + DOUBT)
        weights /= weights.sum()
        if 1 / (weights @ weights) < TOO_FEW * GUESSES:
            places = (self._rng.random() + np.arange(GUESSES)) / GUESSES
            kept = np.minimum(weights.cumsum().searchsorted(places), GUESSES - 1)
            logs, rows, weights = logs[kept], rows[kept], np.full(GUESSES, 1 / GUESSES)
            logs = self._spread(logs, SPREADING * logs.std(axis=0))
        self._of[name] = Guesses(weights, logs, rows)

    def _spread(self, logs: FloatArray, by: FloatArray | float = 0.0) -> FloatArray:
        spread = self._rng.normal(logs, np.maximum(by, self._least))
        return np.clip(spread, *self._bounds)

    def draw(self, rng: np.random.Generator, shot: Snapshot, count: int) -> IntArray:
        """Draw guesses for the other vehicles of a snapshot, shape (count, N)."""
        draws = rng.random((len(shot.ids) - 1, count))
        drawn = [
            self._of[name].weights.cumsum().searchsorted(row)
            for name, row in zip(shot.ids[1:], draws, strict=True)
        ]
        return np.minimum(np.array(drawn, np.int64).reshape(-1, count).T, GUESSES - 1)

    def expected(self, shot: Snapshot) -> IntArray:
        """Return the guess of the median desired speed of each other vehicle, shape (1, N)."""
        found = np.zeros((1, len(shot.ids) - 1), np.int64)
        for place, name in enumerate(shot.ids[1:]):
            order = self._of[name].logs[:, 0].argsort()
            half = self._of[name].weights[order].cumsum().searchsorted(0.5)
            found[0, place] = order[half]
        return found

    def values(self, shot: Snapshot, guess: IntArray) -> tuple[FloatArray, IntArray]:
        """Return the parameters of guesses of the other vehicles, shape (worlds, N).

        The first array, shape (3, worlds, N), holds desired speed, headway and acceleration; the
        second holds the rows in the drawn population.
        """
        logs, rows = np.zeros((3, *guess.shape)), np.zeros(guess.shape, np.int64)
        for place, name in enumerate(shot.ids[1:]):
            logs[:, :, place] = self._of[name].logs[guess[:, place]].T
            rows[:, place] = self._of[name].rows[guess[:, place]]
        return np.exp(logs), rows

    def put(self, shot: Snapshot, guess: IntArray, worlds: TwinVectorEnv) -> None:
        """Give the others in each world the parameters of their guess, shape (worlds, N)."""
        (x, z, _, near), net = worlds.worlds, worlds.task.net
        others = slice(1, guess.shape[1] + 1)
        values, rows = self.values(shot, guess)
        for row, value in zip((DESIRED_M_S, HEADWAY_S, ACCELERATION_M_S2), values, strict=True):
            x[:, row, others] = value
        with np.errstate(divide="ignore"):
            x[:, THRESHOLD_LEFT, others] = GAIN / self._drawn.speed_gain[rows]
        x[:, THRESHOLD_RIGHT, others] = RIGHT_RELUCTANCE * x[:, THRESHOLD_LEFT, others]
        for lane in range(net.first_open, net.last_open + 1):
            x[:, EXPECTED_M_S + lane, others] = x[:, DESIRED_M_S, others]
        if self._models.any():
            z[:, MODEL, others] = self._models[rows]
            z[:, ON_REQUEST_ONLY] = z[:, MODEL] != DriverModel.SUMO
            x[:, WISH_M_S2] = np.where(z[:, ON_REQUEST_ONLY], 0.0, np.nan)
            places = PLACES[z[:, MODEL, : others.stop]]
            z[:, DRIVERS, : others.stop] = places.argsort(axis=1, kind="stable")
            near[:, DRIVER_COUNT] = (places < len(ORDER)).sum(axis=1)
            near[:, KEEPS_DISTANCE] |= near[:, DRIVER_COUNT] > 0

    def _is_truck(self, length_m: FloatArray) -> BoolArray:
        return abs(length_m - self._truck_m) < abs(length_m - self._car_m)
