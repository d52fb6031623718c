"""Thousands of episodes at once in the twin, for training at scale (ours)."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.compiled import compiled, numbers
from drl_av.config import Config
from drl_av.driving.actions import HARD_BRAKE, SIGNS, EgoNumbers, ego_numbers
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
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    ADVICE_M_S,
    ASIDE_M,
    COUNT,
    DESIRED_M_S,
    EXPECTED_M_S,
    FRONT_M,
    HEADWAY_S,
    IS_FULL,
    LANE,
    LATERAL_SPEED_M_S,
    LENGTH_M,
    MASK,
    ORDER,
    REQUEST_END,
    REQUEST_LANE,
    RESERVED,
    SHADOW,
    SPEED_M_S,
    STEP,
    THRESHOLD_LEFT,
    THRESHOLD_RIGHT,
    TRACKED,
    WANTED_SPEED_M_S,
    WIDTH_M,
    Loop,
    World,
    Worlds,
    empty_worlds,
)

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
    facts: FloatArray


@compiled
def place(world: World, loop: Loop, s_m: FloatArray, y_m: FloatArray) -> None:
    """Write the centres of all bodies of a world."""
    for i in range(world.near[COUNT]):
        s_m[i] = (world.x[FRONT_M, i] - world.x[LENGTH_M, i] / 2) % loop.lap_m
        y_m[i] = world.z[LANE, i] * loop.lane_m + world.x[ASIDE_M, i]


@compiled
def observe(world: World, w: int, setting: Setting, egos: Egos) -> None:
    """Compute the indicators, the mask and the wide observation of the world ``w``."""
    n = world.near[COUNT]
    s_m, y_m = np.empty(n), np.empty(n)
    place(world, setting.loop, s_m, y_m)
    speed, lateral = world.x[SPEED_M_S, :n], world.x[LATERAL_SPEED_M_S, :n]
    length_m, width_m = world.x[LENGTH_M, :n], world.x[WIDTH_M, :n]
    values, codes, executed = egos.values[w], egos.codes[w], egos.executed[w]
    origin, target = egos.change[w, 0], egos.change[w, 1]
    road, range_m, rules = setting.road, setting.range_m, np.empty(12, np.int64)
    indicators(s_m, y_m, speed, lateral, length_m, width_m, road, range_m, values, codes)
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
        range_m,
        setting.ego.max_speed_m_s,
        origin,
        target,
        egos.observation[w, :WIDE_SIZE],
    )
    some = False
    for action in range(12):
        permitted = executed[action] == action
        egos.permitted[w, action] = permitted
        egos.observation[w, WIDE_SIZE + action] = 1.0 if permitted else 0.0
        some = some or permitted
    if not some:
        egos.permitted[w, :] = True


@compiled
def decide(
    world: World, w: int, setting: Setting, egos: Egos, action: int, draws: FloatArray
) -> tuple[float, int]:
    """Make one decision in the world ``w``; return its reward and the kind of the collision.

    ``draws``, shape (2, vehicles), holds random numbers for the random lane changes.
    """
    loop, how, n = setting.loop, setting.reward, world.near[COUNT]
    steps = setting.ego.steps_per_decision
    speeds, y, lateral = np.empty(steps), np.empty(steps), np.empty(steps)
    executed = egos.executed[w, action]
    origin, target = egos.change[w, 0], egos.change[w, 1]
    aborts = origin != target and SIGNS[executed // 4] == origin - target
    origin, target, _ = plan_into(
        egos.values[w],
        egos.codes[w],
        executed,
        origin,
        target,
        0.0,
        loop.lane_m,
        setting.ego,
        speeds,
        y,
        lateral,
    )
    egos.change[w, 0], egos.change[w, 1] = origin, target
    for i in range(1, n):
        if draws[0, i] < setting.chance:
            lane = world.z[LANE, i] + (1 if draws[1, i] < 0.5 else -1)
            if loop.first_open <= lane <= loop.last_open:
                world.z[REQUEST_LANE, i] = lane
                world.z[REQUEST_END, i] = world.near[STEP] + REQUEST_STEPS
    before, after = np.empty((2, n)), np.empty((2, n))
    length_m, width_m, kind = world.x[LENGTH_M, :n], world.x[WIDTH_M, :n], NO_CONTACT
    for step in range(steps):
        place(world, loop, before[0], before[1])
        sumo_step(world, loop, speeds[step], y[step])
        place(world, loop, after[0], after[1])
        _, kind, _ = swept_collision(
            before[0], before[1], after[0], after[1], length_m, width_m, loop.lap_m
        )
        if kind != NO_CONTACT:
            break
    world.x[LATERAL_SPEED_M_S, 0] = lateral[-1]
    observe(world, w, setting, egos)
    reward = (world.x[SPEED_M_S, 0] - how.middle_speed_m_s) / how.speed_scale_m_s
    reward -= how.abort_cost if aborts else 0.0
    reward -= how.hard_brake_cost if executed % 4 == HARD_BRAKE else 0.0
    reward -= how.collision_cost if kind != NO_CONTACT else 0.0
    egos.facts[w, 0] = world.x[SPEED_M_S, 0]
    egos.facts[w, 1] = 1.0 if aborts else 0.0
    egos.facts[w, 2] = 1.0 if executed % 4 == HARD_BRAKE else 0.0
    egos.facts[w, 3] = 1.0 if kind != NO_CONTACT else 0.0
    return reward, kind


@compiled
def advance(
    worlds: Worlds,
    setting: Setting,
    egos: Egos,
    action: IntArray,
    draws: FloatArray,
    reward: npt.NDArray[np.float32],
    kind: IntArray,
) -> None:
    """Make one decision in each world."""
    for w in range(len(action)):
        world = World(worlds.x[w], worlds.z[w], worlds.notes[w], worlds.near[w])
        reward[w], kind[w] = decide(world, w, setting, egos, action[w], draws[:, w])


@compiled
def begin(world: World, w: int, setting: Setting, egos: Egos) -> None:
    """Complete the state of a world whose vehicles have been placed."""
    for k in range(world.near[COUNT]):
        world.z[ORDER, k] = k
    insert_sorted(world)
    mark_present(world, setting.loop)
    activate(world, setting.loop)
    egos.change[w, :] = 0
    observe(world, w, setting, egos)


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
        self._overtaking = config.with_traffic("overtaking").traffic
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
            np.zeros((worlds, 4)),
        )
        self.observation, self.permitted = self.egos.observation, self.egos.permitted
        self.decisions = np.zeros(worlds, np.int64)
        self._reward, self._kind = np.zeros(worlds, np.float32), np.zeros(worlds, np.int64)
        self.facts = self.egos.facts
        for w in range(worlds):
            self.restart(w)
        most = config.simulation.decisions_per_episode
        self.decisions[:] = self._rng.integers(0, most, worlds)

    def restart(self, w: int, vehicles: int | None = None, seed: int | None = None) -> None:
        """Begin a new episode in the world ``w``."""
        rng, config = self._rng, self._config
        world = World(*(array[w] for array in self.worlds))
        drawn = int(rng.integers(self._vehicles[0], self._vehicles[1] + 1))
        self.egos.check[w] = 0 if rng.random() < self._paper_share else 1
        overtakes = rng.random() < config.ppo.overtaking_share
        made = draw_population(
            rng if seed is None else np.random.default_rng(seed),
            drawn if vehicles is None else vehicles,
            self.road,
            self._length_m,
            self._overtaking if overtakes else config.traffic,
            config.ego,
        )
        for array in world:
            array[...] = 0
        x, z, n = world.x, world.z, len(made.ids)
        world.near[COUNT], self.decisions[w] = n, 0
        x[FRONT_M, :n], x[SPEED_M_S, :n], z[LANE, :n] = made.front_m, made.speed_m_s, made.lane
        x[LENGTH_M], x[WIDTH_M] = self._length_m, self._width_m
        x[DESIRED_M_S, :n], x[HEADWAY_S, :n] = made.desired_speed_m_s, made.headway_s
        x[ACCELERATION_M_S2, :n], gain = made.acceleration_m_s2, np.maximum(made.speed_gain, 1e-9)
        x[THRESHOLD_LEFT, :n] = np.where(made.speed_gain > 0, 0.2 / gain, np.inf)
        x[THRESHOLD_RIGHT, :n] = np.where(made.speed_gain > 0, 2.0 / gain, np.inf)
        x[EXPECTED_M_S:, :n] = made.desired_speed_m_s
        x[WANTED_SPEED_M_S], x[ADVICE_M_S] = np.inf, np.inf
        z[MASK], z[IS_FULL] = 1 << z[LANE], 1
        for name in (TRACKED, REQUEST_END, REQUEST_LANE, SHADOW, RESERVED):
            z[name] = -1
        begin(world, w, self.setting, self.egos)

    def step(self, action: npt.NDArray[np.int64]) -> Outcome:
        """Execute one action in each world; begin new episodes where one has ended."""
        draws = self._rng.random((2, len(action), self.worlds.x.shape[-1]))
        advance(self.worlds, self.setting, self.egos, action, draws, self._reward, self._kind)
        self.decisions += 1
        terminated = self._kind != NO_CONTACT
        most = self._config.simulation.decisions_per_episode
        truncated = ~terminated & (self.decisions >= most)
        final = self.observation[truncated]
        outcome = Outcome(self._reward.copy(), terminated, truncated, final)
        for w in np.flatnonzero(terminated | truncated):
            self.restart(int(w))
        return outcome
