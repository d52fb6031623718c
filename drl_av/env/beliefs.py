"""What the planner believes of the other drivers' parameters, from their speeds so far (ours).

The beliefs are a particle filter without resampling: guesses of the parameters are drawn once, as
the traffic's settings say, and each vehicle weighs them by how well they predicted its speeds.
"""

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.drivers.background.traffic import ORDER
from drl_av.env.twin_episodes import look_all
from drl_av.env.vector import TwinVectorEnv
from drl_av.road.snapshot import EGO, Snapshot
from drl_av.scenarios.folder import Scenario
from drl_av.simulation.population import (
    DriverModel,
    Population,
    StartPositions,
    draw_driver_models,
    draw_trucks,
    with_drivers,
)
from drl_av.twin.traffic import GAIN, RIGHT_RELUCTANCE
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
    FloatArray,
    IntArray,
)

GUESSES = 128
SPREAD_M_S, DOUBT = 0.1, 0.02
"""How far a good prediction of a speed a second later may be off; and the likelihood of any other
speed, such as after a random lane change, relative to that of an exact prediction."""
PLACES = np.array([ORDER.index(model) if model in ORDER else len(ORDER) for model in DriverModel])
"""For each ``DriverModel``, its place in the order in which our own drivers decide."""


class Beliefs:
    """Weighs ``GUESSES`` guesses of a driver's parameters for each vehicle, by its name."""

    def __init__(self, rng: np.random.Generator, scenario: Scenario, config: Config) -> None:
        self._car_m, traffic = scenario.vehicle_types.traffic.length_m, config.traffic
        self._truck_m = traffic.truck_length_m
        self._guesses, self._models = draw_guesses(rng, config)
        self._weights: dict[str, FloatArray] = {}

    def population(self, shot: Snapshot) -> Population:
        """Return the vehicles of a snapshot, all with the parameters of the first guess."""
        population = self._guesses.rows([0] * len(shot.ids))
        population.is_truck[:] = self._is_truck(shot.length_m)
        population.is_truck[EGO] = False
        return population

    def see(self, shot: Snapshot) -> None:
        """Take in the vehicles that were never seen before; a truck has the guesses of trucks."""
        for name, is_truck in zip(shot.ids, self._is_truck(shot.length_m).tolist(), strict=True):
            if name not in self._weights:
                fits = self._guesses.is_truck == is_truck
                weights = fits if fits.any() else np.ones(GUESSES)
                self._weights[name] = weights / weights.sum()

    def learn(self, name: str, predicted_m_s: FloatArray, speed_m_s: float) -> None:
        """Weigh the guesses anew by what they predicted, shape (GUESSES,), and what came."""
        error = (predicted_m_s - speed_m_s) / SPREAD_M_S
        weights = self._weights[name] * (np.exp(-0.5 * error * error) + DOUBT)
        self._weights[name] = weights / weights.sum()

    def draw(self, rng: np.random.Generator, shot: Snapshot, count: int) -> IntArray:
        """Draw guesses for the other vehicles of a snapshot, shape (count, N)."""
        draws = rng.random((len(shot.ids) - 1, count))
        drawn = [
            self._weights[name].cumsum().searchsorted(row)
            for name, row in zip(shot.ids[1:], draws, strict=True)
        ]
        return np.minimum(np.array(drawn, np.int64).reshape(-1, count).T, GUESSES - 1)

    def put(self, guess: IntArray, worlds: TwinVectorEnv) -> None:
        """Give the others in each world the parameters of their guess, shape (worlds, N)."""
        (x, z, _, near), loop, given = worlds.worlds, worlds.task.loop, self._guesses
        others = slice(1, guess.shape[1] + 1)
        x[:, DESIRED_M_S, others] = given.desired_speed_m_s[guess]
        x[:, HEADWAY_S, others] = given.headway_s[guess]
        x[:, ACCELERATION_M_S2, others] = given.acceleration_m_s2[guess]
        with np.errstate(divide="ignore"):
            x[:, THRESHOLD_LEFT, others] = GAIN / given.speed_gain[guess]
        x[:, THRESHOLD_RIGHT, others] = RIGHT_RELUCTANCE * x[:, THRESHOLD_LEFT, others]
        for lane in range(loop.first_open, loop.last_open + 1):
            x[:, EXPECTED_M_S + lane, others] = x[:, DESIRED_M_S, others]
        if self._models.any():
            z[:, MODEL, others] = self._models[guess]
            z[:, ON_REQUEST_ONLY] = z[:, MODEL] != DriverModel.SUMO
            x[:, WISH_M_S2] = np.where(z[:, ON_REQUEST_ONLY], 0.0, np.nan)
            places = PLACES[z[:, MODEL, : others.stop]]
            z[:, DRIVERS, : others.stop] = places.argsort(axis=1, kind="stable")
            near[:, DRIVER_COUNT] = (places < len(ORDER)).sum(axis=1)
            near[:, KEEPS_DISTANCE] |= near[:, DRIVER_COUNT] > 0
        look_all(worlds.worlds, worlds.episodes, worlds.task, np.arange(worlds.num_envs))

    def _is_truck(self, length_m: FloatArray) -> npt.NDArray[np.bool_]:
        found: npt.NDArray[np.bool_] = abs(length_m - self._truck_m) < abs(length_m - self._car_m)
        return found


def draw_guesses(rng: np.random.Generator, config: Config) -> tuple[Population, IntArray]:
    """Draw the parameters of ``GUESSES`` drivers of a kind of traffic, and their models."""
    n, traffic, streams = GUESSES + 1, config.traffic, rng.spawn(2)
    lane, free_m = np.zeros(n, np.intp), np.full(n, np.inf)
    nowhere = StartPositions(lane, np.zeros(n), free_m, lane)
    is_truck = draw_trucks(streams[1], n, traffic)
    drawn = with_drivers(rng, streams, nowhere, is_truck, traffic, config.ego)
    models = draw_driver_models(int(rng.integers(2**31)), n, traffic).astype(np.int64)
    return drawn.rows(range(1, n)), models[1:]
