"""Thousands of episodes at once in the twin, for training at scale (ours)."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.compiled import compiled, numbers
from drl_av.config import Config
from drl_av.driving.actions import EgoNumbers, ego_numbers
from drl_av.driving.affordances import CODES, VALUES, indicators
from drl_av.driving.maneuver import plan_into
from drl_av.driving.wide_observation import WIDE_SIZE, wide_observation
from drl_av.learning.ppo import Outcome
from drl_av.road.road import FloatArray
from drl_av.road.road_numbers import RoadNumbers, road_numbers
from drl_av.road.sweep import NO_CONTACT, swept_collision
from drl_av.safety.paper import SafetyNumbers, paper_verdicts
from drl_av.safety.reachability import StrictNumbers
from drl_av.safety.strict import strict_verdicts
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.simulation.population import draw_population
from drl_av.twin.active_lanes import activate, mark_present
from drl_av.twin.neighbors import insert_sorted
from drl_av.twin.step import sumo_step
from drl_av.twin.worlds import Loop, Worlds, empty_worlds

IntArray = npt.NDArray[np.int64]
REQUEST_STEPS = 10


class RewardNumbers(NamedTuple):
    """The settings of the section ``ppo`` that define the reward."""

    middle_speed_m_s: float
    speed_scale_m_s: float
    abort_cost: float
    hard_brake_cost: float
    collision_cost: float


class Setting(NamedTuple):
    """What is the same in all worlds."""

    loop: Loop
    road: RoadNumbers
    ego: EgoNumbers
    safety: SafetyNumbers
    strict: StrictNumbers
    range_m: float
    chance: float
    reward: RewardNumbers


class Egos(NamedTuple):
    """What the twin does not know about each world; arrays of shape (W, ...)."""

    change: IntArray
    values: FloatArray
    codes: IntArray
    check: IntArray
    permitted: npt.NDArray[np.bool_]
    observation: npt.NDArray[np.float32]
    executed: IntArray


@compiled
def place(worlds: Worlds, w: int, setting: Setting, s_m: FloatArray, y_m: FloatArray) -> None:
    """Write the centres of all bodies of a world."""
    loop = setting.loop
    for i in range(worlds.count[w]):
        s_m[i] = (worlds.front_m[w, i] - worlds.length_m[w, i] / 2) % loop.lap_m
        y_m[i] = worlds.lane[w, i] * loop.lane_m + worlds.aside_m[w, i]


@compiled
def observe(worlds: Worlds, w: int, setting: Setting, egos: Egos) -> None:
    """Compute the indicators, the mask and the wide observation of a world."""
    n = worlds.count[w]
    s_m, y_m = np.empty(n), np.empty(n)
    place(worlds, w, setting, s_m, y_m)
    speed, lateral = worlds.speed_m_s[w, :n], worlds.lateral_speed_m_s[w, :n]
    length_m, width_m = worlds.length_m[w, :n], worlds.width_m[w, :n]
    values, codes = egos.values[w], egos.codes[w]
    origin, target = egos.change[w, 0], egos.change[w, 1]
    road = setting.road
    indicators(s_m, y_m, speed, lateral, length_m, width_m, road, setting.range_m, values, codes)
    executed, rules = egos.executed[w], np.empty(12, np.int64)
    if egos.check[w] == 0:
        paper_verdicts(values, codes, origin, target, setting.safety, executed, rules)
    else:
        strict_verdicts(
            s_m,
            y_m,
            speed,
            lateral,
            length_m,
            width_m,
            codes,
            origin,
            target,
            road.lap_m,
            road.lane_width_m,
            road.barriers,
            0.0,
            setting.strict,
            setting.ego,
            executed,
            rules,
        )
    wide_observation(
        s_m,
        y_m,
        speed,
        lateral,
        length_m,
        width_m,
        road,
        setting.range_m,
        setting.ego.max_speed_m_s,
        origin,
        target,
        egos.observation[w, :WIDE_SIZE],
    )
    some = False
    for a in range(12):
        egos.permitted[w, a] = executed[a] == a
        some = some or executed[a] == a
        egos.observation[w, WIDE_SIZE + a] = 1.0 if executed[a] == a else 0.0
    if not some:
        egos.permitted[w, :] = True


@compiled
def advance(
    worlds: Worlds,
    setting: Setting,
    egos: Egos,
    action: IntArray,
    draws: FloatArray,
    reward: npt.NDArray[np.float32],
    kind: IntArray,
    facts: FloatArray,
) -> None:
    """Make one decision in each world."""
    loop, ego = setting.loop, setting.ego
    steps = ego.steps_per_decision
    speeds, y, lateral = np.empty(steps), np.empty(steps), np.empty(steps)
    for w in range(len(worlds.count)):
        n = worlds.count[w]
        executed = egos.executed[w, action[w]]
        origin, target = egos.change[w, 0], egos.change[w, 1]
        side = (0, -1, 1)[executed // 4]
        aborts = origin != target and side == origin - target
        origin, target, _ = plan_into(
            egos.values[w],
            egos.codes[w],
            executed,
            origin,
            target,
            0.0,
            loop.lane_m,
            ego,
            speeds,
            y,
            lateral,
        )
        egos.change[w, 0], egos.change[w, 1] = origin, target
        for i in range(1, n):
            if draws[0, w, i] < setting.chance:
                lane = worlds.lane[w, i] + (1 if draws[1, w, i] < 0.5 else -1)
                if loop.first_open <= lane <= loop.last_open:
                    worlds.request_lane[w, i] = lane
                    worlds.request_end[w, i] = worlds.step[w] + REQUEST_STEPS
        s0, y0, s1, y1 = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
        kind[w] = NO_CONTACT
        for step in range(steps):
            place(worlds, w, setting, s0, y0)
            sumo_step(worlds, loop, w, speeds[step], y[step])
            place(worlds, w, setting, s1, y1)
            _, found, _ = swept_collision(
                s0, y0, s1, y1, worlds.length_m[w, :n], worlds.width_m[w, :n], loop.lap_m
            )
            if found != NO_CONTACT:
                kind[w] = found
                break
        worlds.lateral_speed_m_s[w, 0] = lateral[steps - 1]
        observe(worlds, w, setting, egos)
        how = setting.reward
        speed = worlds.speed_m_s[w, 0]
        gained = (speed - how.middle_speed_m_s) / how.speed_scale_m_s
        gained -= how.abort_cost if aborts else 0.0
        gained -= how.hard_brake_cost if executed % 4 == 3 else 0.0
        gained -= how.collision_cost if kind[w] != NO_CONTACT else 0.0
        reward[w] = gained
        facts[w, 0] = speed
        facts[w, 1] = 1.0 if aborts else 0.0
        facts[w, 2] = 1.0 if executed % 4 == 3 else 0.0


@compiled
def begin(worlds: Worlds, w: int, setting: Setting, egos: Egos) -> None:
    """Complete the state of a world whose vehicles have been placed."""
    n = worlds.count[w]
    for k in range(n):
        worlds.order[w, k] = k
    insert_sorted(worlds, w)
    worlds.active_count[w] = 0
    mark_present(worlds, setting.loop, w)
    activate(worlds, setting.loop, w)
    egos.change[w, :] = 0
    observe(worlds, w, setting, egos)


class TwinWorlds:
    """W worlds in the twin, each with its own traffic."""

    def __init__(self, config: Config, seed: int) -> None:
        worlds, paper_share = config.ppo.worlds, config.ppo.paper_share
        vehicles = config.traffic.vehicles_min, config.traffic.vehicles_max
        reward = numbers(RewardNumbers, config.ppo)
        scenario = load_scenario(find_scenario(config.simulation.scenario))
        self._config, self.road = config, scenario.road
        self._length_m = scenario.description.vehicle_length_m
        self._width_m = scenario.description.vehicle_width_m
        self._vehicles, self._paper_share = vehicles, paper_share
        self._rng = np.random.default_rng(seed)
        lanes = len(self.road.open_lanes)
        self.worlds = empty_worlds(worlds, vehicles[1] + 1, lanes)
        loop = Loop(
            self.road.lap_m,
            self.road.lap_m / 4,
            self.road.lane_width_m,
            lanes,
            0,
            lanes - 1,
            float(scenario.description.speed_limit_m_s),
            False,
            False,
        )
        ego = ego_numbers(config.ego, config.simulation)
        self.setting = Setting(
            loop,
            road_numbers(self.road),
            ego,
            numbers(SafetyNumbers, config.safety),
            numbers(StrictNumbers, config.strict),
            float(config.observation.range_m),
            config.traffic.random_lane_changes_per_s,
            reward,
        )
        self.egos = Egos(
            np.zeros((worlds, 2), np.int64),
            np.zeros((worlds, VALUES)),
            np.zeros((worlds, CODES), np.int64),
            np.zeros(worlds, np.int64),
            np.zeros((worlds, 12), np.bool_),
            np.zeros((worlds, WIDE_SIZE + 12), np.float32),
            np.zeros((worlds, 12), np.int64),
        )
        self.observation, self.permitted = self.egos.observation, self.egos.permitted
        self.decisions = np.zeros(worlds, np.int64)
        self._reward, self._kind = np.zeros(worlds, np.float32), np.zeros(worlds, np.int64)
        self.facts = np.zeros((worlds, 4))
        for w in range(worlds):
            self.restart(w)
        most = config.simulation.decisions_per_episode
        self.decisions[:] = self._rng.integers(0, most, worlds)

    def restart(self, w: int, vehicles: int | None = None, seed: int | None = None) -> None:
        """Begin a new episode in the world ``w``."""
        rng, config, its = self._rng, self._config, self.worlds
        drawn = int(rng.integers(self._vehicles[0], self._vehicles[1] + 1))
        self.egos.check[w] = 0 if rng.random() < self._paper_share else 1
        made = draw_population(
            rng if seed is None else np.random.default_rng(seed),
            drawn if vehicles is None else vehicles,
            self.road,
            self._length_m,
            config.traffic,
            config.ego,
        )
        n = len(made.ids)
        for name, array in its._asdict().items():
            if name not in ("count", "step"):
                array[w] = 0
        its.count[w], its.step[w], self.decisions[w] = n, 0, 0
        its.front_m[w, :n], its.speed_m_s[w, :n] = made.front_m, made.speed_m_s
        its.lane[w, :n] = made.lane
        its.shadow[w], its.reserved[w], its.request_lane[w] = -1, -1, -1
        its.length_m[w], its.width_m[w] = self._length_m, self._width_m
        its.desired_m_s[w, :n], its.headway_s[w, :n] = made.desired_speed_m_s, made.headway_s
        its.acceleration_m_s2[w, :n] = made.acceleration_m_s2
        its.threshold_left[w, :n] = 0.2 / np.maximum(0.001, made.speed_gain)
        its.threshold_right[w, :n] = 2.0 / np.maximum(0.001, made.speed_gain)
        its.wanted_speed_m_s[w], its.advice_m_s[w] = np.inf, np.inf
        its.expected_m_s[w, :n] = made.desired_speed_m_s[:, None]
        begin(its, w, self.setting, self.egos)

    def step(self, action: npt.NDArray[np.int64]) -> Outcome:
        """Execute one action in each world; begin new episodes where one has ended."""
        draws = self._rng.random((2, *self.worlds.front_m.shape))
        arguments: Any = (self.worlds, self.setting, self.egos, action, draws)
        advance(*arguments, self._reward, self._kind, self.facts)
        self.decisions += 1
        terminated = self._kind != NO_CONTACT
        most = self._config.simulation.decisions_per_episode
        truncated = ~terminated & (self.decisions >= most)
        final = self.observation[truncated]
        self.facts[:, 3] = terminated
        for w in np.flatnonzero(terminated | truncated):
            self.restart(int(w))
        return Outcome(self._reward, terminated, truncated, final)
