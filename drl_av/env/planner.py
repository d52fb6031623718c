"""The planner: it tries the likeliest actions of the shipped driver in the twin (ours).

Each decision is a step of policy improvement by rollouts (Tesauro and Galperin 1996; Bertsekas,
Tsitsiklis and Wu 1997). What the others will do is not known: all actions are tried in the future
that their speeds so far make likely (``Beliefs``), and the best few in random ones, for which their
parameters and their random lane changes are drawn.
"""

from functools import cache

import numpy as np
from threadpoolctl import ThreadpoolController

from drl_av.arrays import Float32Array, FloatArray, IntArray
from drl_av.config import Config
from drl_av.config.learning import SPAN_M_S
from drl_av.drivers.driver import Driver
from drl_av.drivers.learned import actor_driver, load_actor
from drl_av.drivers.network import Layers
from drl_av.drivers.policy_file import PRETRAINED
from drl_av.driving.actions import ACTIONS, HARD_BRAKE, Action
from drl_av.driving.maneuver import aborts
from drl_av.driving.scene import Scene
from drl_av.env.beliefs import GUESSES, Beliefs
from drl_av.env.fork import place_ego, twin_of
from drl_av.env.twin_episodes import decide_all
from drl_av.env.wide_view import most_probable_actions
from drl_av.errors import ConfigError
from drl_av.random_streams import Stream, generator, kind_of_traffic
from drl_av.road.snapshot import EGO, Snapshot
from drl_av.road.sweep import NO_CONTACT
from drl_av.safety import named_check
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.twin.copying import copy_scene

TRIED, HELD = 6, (1, 3)
"""Most actions that are tried at a decision, the likeliest of the base policy; and the numbers of
decisions, of 1 s each, for which a trial holds each of them."""
FEW, FUTURES = 3, 6
"""How many actions, beside the base policy's, are tried in random futures; and in how many."""
HORIZON = 30
"""Decisions that a trial takes; the base policy makes all but the first or the first few."""
SURENESS = 0.5
"""Standard errors by which an action has to be better than that of the base policy."""
DISCOUNT, HIT_COST_M = 0.99, 50.0
"""What a metre is worth a second later, and what a collision costs."""
BLIND_M = 100.0
"""A vehicle with less road in view ahead may follow one that the ego does not see."""
REQUEST_STEPS = 10
"""Steps for which a lane change that is under way is taken to be wanted."""


class PlannerDriver(Driver):
    """Proposes the action after which the shipped driver comes farthest in the twin.

    It knows the settings ``traffic`` from which the parameters of the others are drawn, with
    several ``traffic.presets`` those of the episode's, but not the parameters of any vehicle. It
    sees the vehicles within ``observation.range_m``.

    Args:
        actor: The layers and the config of the base policy.
        config: The settings of the environment.

    Raises:
        ConfigError: the twin cannot do what the settings ask, such as open roads.
    """

    def __init__(self, actor: tuple[Layers, Config], config: Config) -> None:
        said, kinds = (
            ("The planner tries its actions", "name another driver"),
            config.per_traffic_preset,
        )
        self._kinds = [(kind, twin_of(*said, kind, action_mask=False)) for kind in kinds]
        if not self._kinds[0][1].road.is_loop:
            raise ConfigError(
                "The planner follows the shipped driver, which knows no roads that end: take a "
                "loop, or name another driver."
            )
        for _, twin in self._kinds:
            twin.reset(seed=0, options={"vehicles": 0})
        self._scenario = load_scenario(find_scenario(config.simulation.scenario))
        check = named_check(config, self._scenario.vehicle_types, self._scenario.road)
        self._base = actor_driver("planner", actor, config, check)
        self._layers, self._paid = actor[0], actor[1].ppo
        self._road = self._scenario.road
        self._range_m = config.observation.range_m
        self.start(0)

    def start(self, seed: int) -> None:
        """Forget all vehicles; ``seed`` draws the kind of traffic, and the futures to be tried."""
        self._kind, self._twin = kind_of_traffic(seed, self._kinds)
        self._rng = generator(seed, Stream.PLANS)
        self._beliefs = Beliefs(self._rng, self._scenario, self._kind)
        self._speeds: dict[str, float] = {}
        self._predicted: dict[str, FloatArray] = {}

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return the best of the likeliest permitted actions; ``observation`` is not used.

        Raises:
            ConfigError: the scene is on another road than that of the settings.
        """
        if scene.road != self._road:
            raise ConfigError(
                "The planner was loaded for another road than that of the scene: give load_driver "
                "the config of the environment."
            )
        shot = scene.snapshot
        away_m = self._road.ahead_m(shot.s_m[EGO], shot.s_m)
        shot = shot.of_rows(np.flatnonzero(np.abs(away_m) <= self._range_m).tolist())
        self._beliefs.see(shot)
        speeds = dict(zip(shot.ids, shot.speed_m_s.tolist(), strict=True))
        for name, predicted in self._predicted.items():
            if name in speeds:
                self._beliefs.learn(name, predicted, speeds[name])
        self._place(shot, scene)
        with _libraries().limit(limits=1, user_api="blas"):  # more threads only wait for each other
            best = self._best(shot, scene)
        self._predicted, self._speeds = self._predictions(shot, best), speeds
        return ACTIONS[best]

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

    def _best(self, shot: Snapshot, scene: Scene) -> int:
        """Return the number of the best action.

        Each is tried in the expected future, and held there for as long as is better for it; then
        the best few, and that of the base policy, in random futures.
        """
        logits, of = self._base.logits(scene), self._beliefs
        likely = np.argsort(-logits, kind="stable")[:TRIED]
        likely = likely[np.isfinite(logits[likely])]
        if len(likely) == 1:
            return int(likely[0])
        plans = np.array([(action, held) for action in likely.tolist() for held in HELD])
        worth_m = self._worth_m(shot, scene, plans, of.expected(shot), None)
        worth_m = worth_m.reshape(len(likely), len(HELD))
        plans = plans.reshape(*worth_m.shape, 2)[np.arange(len(likely)), worth_m.argmax(axis=1)]
        best_m = worth_m.max(axis=1)
        best = 1 + np.argsort(-best_m[1:], kind="stable")[:FEW]
        plans = plans[[0, *best[best_m[best] > best_m[0]]]]
        if len(plans) > 1:
            guess, seed = of.draw(self._rng, shot, FUTURES), int(self._rng.integers(2**31))
            gain_m = self._worth_m(shot, scene, plans, guess, seed)
            gain_m -= gain_m[0].copy()
            doubt_m = gain_m.std(axis=1) / FUTURES**0.5
            plans = plans[[(gain_m.mean(axis=1) - SURENESS * doubt_m).argmax()]]
        return int(plans[0, 0])

    def _worth_m(
        self, shot: Snapshot, scene: Scene, plans: IntArray, guess: IntArray, seed: int | None
    ) -> FloatArray:
        """Return how far the ego comes by each plan in each future, less the price of the plan.

        The price is what the training of the base policy charged for aborts and hard braking. The
        arguments and the shape of the result are those of ``_ways_m``.
        """
        running, paid, (tried, held) = scene.lane_change, self._paid, plans.T
        gives_up = np.array([aborts(running, ACTIONS[number].lateral) for number in tried])
        brakes = held * (tried % 4 == HARD_BRAKE)
        costs = paid.abort_cost * gives_up + paid.hard_brake_cost * brakes
        worth_m: FloatArray = self._ways_m(shot, plans, guess, seed)
        worth_m -= SPAN_M_S * costs[:, np.newaxis]
        return worth_m

    def _ways_m(
        self, shot: Snapshot, plans: IntArray, guess: IntArray, seed: int | None
    ) -> FloatArray:
        """Try plans, each in the same futures; return how far the ego comes, discounted.

        Args:
            shot: The scene.
            plans: Actions, and the decisions for which each is held, shape (plans, 2).
            guess: The guesses of the others' parameters, shape (futures, N).
            seed: Draws the random lane changes; without it there are none.

        Returns:
            Metres, shape (plans, futures).
        """
        count = len(plans) * len(guess)
        trials = self._twin.fork(count, include_rng=True)
        if seed is not None:
            drawn = self._twin.fork(len(guess), seed).episodes
            trials.make_room(0, drawn.events.shape[1])
            trials.episodes.events[:] = np.tile(drawn.events, (len(plans), 1, 1))
            trials.episodes.next_event[:] = np.tile(drawn.next_event, (len(plans), 1))
        self._beliefs.put(shot, np.tile(guess, (len(plans), 1)), trials)
        worlds, episodes, task = trials.worlds, trials.episodes, trials.task
        begun, until = np.repeat(plans, len(guess), axis=0).T.copy()
        actions, ways_m, goes_on = begun, np.zeros(count), np.arange(count)
        for decision in range(HORIZON):
            decide_all.fast(worlds, episodes, task, goes_on, actions)
            hit = episodes.collision[goes_on, 0] != NO_CONTACT
            metres = episodes.scene[goes_on, 2, 0] - HIT_COST_M * hit
            ways_m[goes_on] += DISCOUNT**decision * metres
            goes_on = goes_on[~hit]
            actions = most_probable_actions(self._layers, trials)
            actions = np.where(until > decision + 1, begun, actions)
        return ways_m.reshape(len(plans), len(guess))

    def _predictions(self, shot: Snapshot, action: int) -> dict[str, FloatArray]:
        """Return what each guess predicts of each vehicle's speed a second later."""
        worlds, others = self._twin.fork(GUESSES, include_rng=True), len(shot.ids) - 1
        self._beliefs.put(
            shot, np.repeat(np.arange(GUESSES)[:, np.newaxis], others, axis=1), worlds
        )
        arrays, rows = (worlds.worlds, worlds.episodes, worlds.task), np.arange(GUESSES)
        decide_all.fast(*arrays, rows, np.full(GUESSES, action))
        in_view_m = self._range_m - self._road.ahead_m(shot.s_m[EGO], shot.s_m)
        seen = [row for row in np.flatnonzero(in_view_m > BLIND_M).tolist() if row != EGO]
        return {shot.ids[row]: worlds.episodes.scene[:, 2, row] for row in seen}


@cache
def _libraries() -> ThreadpoolController:
    """Return what sets the threads of the libraries that numpy uses."""
    return ThreadpoolController()


def planner(config: Config) -> PlannerDriver:
    """Return the planner with the shipped driver as its base policy."""
    return PlannerDriver(load_actor(PRETRAINED), config)
