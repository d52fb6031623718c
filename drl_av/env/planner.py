"""The planner: it tries the likeliest actions of the shipped driver in the twin (ours).

Each decision is a step of policy improvement by rollouts (Tesauro and Galperin 1996; Bertsekas,
Tsitsiklis and Wu 1997). What the others will do is not known: each rollout draws their parameters
from what their speeds so far made likely (``Beliefs``), and their random lane changes anew.
"""

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

from drl_av.config import Config
from drl_av.config.learning import SPAN_M_S
from drl_av.drivers.background.traffic import ORDER
from drl_av.drivers.driver import Driver
from drl_av.drivers.masked_policy import actor_driver, load_actor
from drl_av.drivers.network import Layers
from drl_av.drivers.policy_file import PRETRAINED, find_policy
from drl_av.driving.actions import ACTIONS, HARD_BRAKE, Action
from drl_av.driving.maneuver import aborts
from drl_av.driving.scene import Scene
from drl_av.env.fork import place_ego
from drl_av.env.twin_episodes import look_all
from drl_av.env.vector import TwinVectorEnv
from drl_av.env.wide_view import most_probable_actions
from drl_av.errors import ConfigError
from drl_av.random_streams import Stream, generator
from drl_av.road.snapshot import EGO, Snapshot
from drl_av.safety import named_check
from drl_av.scenarios.folder import Scenario, find_scenario, load_scenario
from drl_av.simulation.population import (
    DriverModel,
    Population,
    StartPositions,
    draw_driver_models,
    draw_trucks,
    with_drivers,
)
from drl_av.twin.copying import copy_scene
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
        (x, z, _, near), net, given = worlds.worlds, worlds.task.net, self._guesses
        others = slice(1, guess.shape[1] + 1)
        x[:, DESIRED_M_S, others] = given.desired_speed_m_s[guess]
        x[:, HEADWAY_S, others] = given.headway_s[guess]
        x[:, ACCELERATION_M_S2, others] = given.acceleration_m_s2[guess]
        with np.errstate(divide="ignore"):
            x[:, THRESHOLD_LEFT, others] = GAIN / given.speed_gain[guess]
        x[:, THRESHOLD_RIGHT, others] = RIGHT_RELUCTANCE * x[:, THRESHOLD_LEFT, others]
        for lane in range(net.first_open, net.last_open + 1):
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
        return abs(length_m - self._truck_m) < abs(length_m - self._car_m)


def draw_guesses(rng: np.random.Generator, config: Config) -> tuple[Population, IntArray]:
    """Draw the parameters of ``GUESSES`` drivers of a kind of traffic, and their models."""
    n, traffic, streams = GUESSES + 1, config.traffic, rng.spawn(2)
    lane, free_m = np.zeros(n, np.intp), np.full(n, np.inf)
    nowhere = StartPositions(lane, np.zeros(n), free_m, lane)
    is_truck = draw_trucks(streams[1], n, traffic)
    drawn = with_drivers(rng, streams, nowhere, is_truck, traffic, config.ego)
    models = draw_driver_models(int(rng.integers(2**31)), n, traffic).astype(np.int64)
    return drawn.rows(range(1, n)), models[1:]


TRIED = 4
"""Most actions that are tried at a decision, the likeliest of the base policy."""
LEAST_PROBABLE = 1e-4
"""An action that is so much less probable than the base policy's best is not tried."""
FUTURES = 8
"""Random futures in which each action is tried."""
HORIZON = 30
"""Decisions, of 1 s each, for which an action is tried; the base policy makes all but the first."""
SURENESS = 1.0
"""Standard errors by which an action has to be better than that of the base policy."""
DISCOUNT, HIT_COST_M = 0.99, 50.0
"""What a metre is worth a second later, and what a collision costs."""
BLIND_M = 100.0
"""A vehicle with less road in view ahead may follow one that the ego does not see."""
REQUEST_STEPS = 10
"""Steps for which a lane change that is under way is taken to be wanted."""


class PlannerDriver(Driver):
    """Proposes the action after which the shipped driver comes farthest in the twin.

    It knows the settings ``traffic`` from which the parameters of the others are drawn, but not
    those of any vehicle. It sees the vehicles within ``observation.range_m``.

    Args:
        actor: The layers and the config of the base policy.
        config: The settings of the environment.

    Raises:
        ConfigError: the twin cannot do what the settings ask, such as open roads.
    """

    def __init__(self, actor: tuple[Layers, Config], config: Config) -> None:
        try:
            self._twin = TwinVectorEnv(
                config=config, action_mask=False, autoreset_mode=AutoresetMode.DISABLED
            )
        except ConfigError as error:
            raise ConfigError(
                f"The planner tries its actions in the twin. {error} Or name another driver."
            ) from error
        if not self._twin.road.is_loop:
            raise ConfigError(
                "The planner follows the shipped driver, which knows no roads that end: take a "
                "loop, or name another driver."
            )
        self._twin.reset(seed=0, options={"vehicles": 0})
        self._scenario = load_scenario(find_scenario(config.simulation.scenario))
        check = named_check(config, self._scenario.vehicle_types, self._scenario.road)
        self._base = actor_driver("planner", actor, config, check)
        self._layers, self._paid = actor[0], actor[1].ppo
        self._road = self._scenario.road
        self._kind, self._range_m = config.per_traffic_preset[0], config.observation.range_m
        self.start(0)

    def start(self, seed: int) -> None:
        """Forget all vehicles; the futures that are tried depend on ``seed``."""
        self._rng = generator(seed, Stream.PLANS)
        self._beliefs = Beliefs(self._rng, self._scenario, self._kind)
        self._speeds: dict[str, float] = {}
        self._predicted: dict[str, FloatArray] = {}

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the best of the likeliest permitted actions; ``observation`` is not used."""
        shot = self._visible(scene.snapshot)
        self._beliefs.see(shot)
        speeds = dict(zip(shot.ids, shot.speed_m_s.tolist(), strict=True))
        for name, predicted in self._predicted.items():
            if name in speeds:
                self._beliefs.learn(name, predicted, speeds[name])
        self._place(shot, scene)
        logits = self._base.logits(scene)
        likely = np.argsort(-logits, kind="stable")[:TRIED]
        tried = likely[logits[likely] >= logits[likely[0]] + np.log(LEAST_PROBABLE)]
        best = int(tried[0])
        if len(tried) > 1:
            gain_m = self._ways_m(shot, tried) - self._costs_m(scene, tried)[:, np.newaxis]
            gain_m -= gain_m[0].copy()
            doubt_m = gain_m.std(axis=1) / FUTURES**0.5
            best = int(tried[(gain_m.mean(axis=1) - SURENESS * doubt_m).argmax()])
        self._predicted, self._speeds = self._predictions(shot, best), speeds
        return ACTIONS[best]

    def _visible(self, shot: Snapshot) -> Snapshot:
        """Return the vehicles within range."""
        away_m = self._road.ahead_m(shot.s_m[EGO], shot.s_m)
        rows = np.flatnonzero(np.abs(away_m) <= self._range_m)
        return Snapshot(
            shot.time_s,
            tuple(shot.ids[row] for row in rows.tolist()),
            s_m=shot.s_m[rows],
            y_m=shot.y_m[rows],
            speed_m_s=shot.speed_m_s[rows],
            lateral_speed_m_s=shot.lateral_speed_m_s[rows],
            length_m=shot.length_m[rows],
            width_m=shot.width_m[rows],
        )

    def _place(self, shot: Snapshot, scene: Scene) -> None:
        """Copy the scene into the world of the twin, without random events to come."""
        twin, others = self._twin, len(shot.ids) - 1
        if twin.vehicles[0] != others:
            twin.reset(seed=0, options={"vehicles": others})
        now = shot.speed_m_s.tolist()
        before = [self._speeds.get(name, v) for name, v in zip(shot.ids, now, strict=True)]
        chosen = np.stack((shot.speed_m_s, shot.speed_m_s - before))
        population, models = self._beliefs.population(shot), np.zeros(others + 1, np.int64)
        requests, where = self._requests(shot), (self._scenario, self._kind)
        world, net = twin.world(0), twin.task.net
        copy_scene(world, net, population, models, shot, requests, chosen, *where)
        twin.episodes.next_event[0] = 0
        place_ego(twin, scene, 0)

    def _requests(self, shot: Snapshot) -> dict[int, tuple[int, int]]:
        """Return the lane changes under way: by row the lane to which it goes, and the steps."""
        lanes, sides = shot.y_m / self._road.lane_width_m, np.sign(shot.lateral_speed_m_s)
        targets = np.where(sides > 0, np.ceil(lanes - 1e-6), np.floor(lanes + 1e-6))
        moving = np.flatnonzero(sides[1:]) + 1
        return {row: (int(targets[row]), REQUEST_STEPS) for row in moving.tolist()}

    def _ways_m(self, shot: Snapshot, tried: IntArray) -> FloatArray:
        """Try actions, each in the same futures; return how far the ego comes, discounted.

        The result has the shape (actions, FUTURES), in metres.
        """
        count = len(tried) * FUTURES
        trials = self._twin.fork(count, int(self._rng.integers(2**31)))
        guess = self._beliefs.draw(self._rng, shot, FUTURES)
        self._beliefs.put(np.tile(guess, (len(tried), 1)), trials)
        episodes = trials.episodes
        for first in range(FUTURES, count, FUTURES):
            episodes.events[first : first + FUTURES] = episodes.events[:FUTURES]
            episodes.next_event[first : first + FUTURES] = episodes.next_event[:FUTURES]
        actions, ways_m = np.repeat(tried, FUTURES), np.zeros(count)
        goes_on = np.ones(count, np.bool_)
        for decision in range(HORIZON):
            _, _, hit, _, info = trials.step(actions)
            metres = info["speed_m_s"] - HIT_COST_M * hit
            ways_m += DISCOUNT**decision * np.where(goes_on, metres, 0.0)
            goes_on &= ~hit
            actions = most_probable_actions(self._layers, trials)
        return ways_m.reshape(len(tried), FUTURES)

    def _costs_m(self, scene: Scene, tried: IntArray) -> FloatArray:
        """Return what the training of the base policy charged for these actions, in metres."""
        running, paid = scene.lane_change, self._paid
        gives_up = np.array([aborts(running, ACTIONS[number].lateral) for number in tried])
        costs = paid.abort_cost * gives_up + paid.hard_brake_cost * (tried % 4 == HARD_BRAKE)
        return np.asarray(costs * SPAN_M_S)

    def _predictions(self, shot: Snapshot, action: int) -> dict[str, FloatArray]:
        """Return what each guess predicts of each vehicle's speed a second later."""
        worlds, others = self._twin.fork(GUESSES, include_rng=True), len(shot.ids) - 1
        self._beliefs.put(np.repeat(np.arange(GUESSES)[:, np.newaxis], others, axis=1), worlds)
        worlds.step(np.full(GUESSES, action))
        in_view_m = self._range_m - self._road.ahead_m(shot.s_m[EGO], shot.s_m)
        seen = [row for row in np.flatnonzero(in_view_m > BLIND_M).tolist() if row != EGO]
        return {shot.ids[row]: worlds.episodes.scene[:, 2, row] for row in seen}


def planner(config: Config) -> PlannerDriver:
    """Return the planner with the shipped driver as its base policy."""
    return PlannerDriver(load_actor(find_policy(PRETRAINED)), config)
