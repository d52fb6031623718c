"""Prepares the rows of ``benchmark.py``: each has a measurement of ours and one of a rival.

A function ``..._rows`` prepares the episodes of the traffic seeds and returns rows; ``stack``
closes the environments at the end.
"""

import math
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from benchmark_drives import (
    decide_only,
    drive,
    drive_only,
    mean_vehicles,
    recorded_actions,
    recorded_calls,
    step_bare,
)

from drl_av.config import SINGLE_PRESETS, Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.policy_file import PRETRAINED
from drl_av.drivers.registry import find_drivers, load_driver, make_drivers, rule_driver
from drl_av.drivers.rule_based import IdmDriver
from drl_av.driving.actions import ACCELERATE, BRAKE
from drl_av.env.highway import HighwayEnv
from drl_av.env.vector import TwinVectorEnv
from drl_av.scenarios.folder import PlacedVehicle, ScenarioDescription, write_scenario
from drl_av.scenarios.highways import StraightDescription
from drl_av.scenarios.road_types import ROAD_TYPES

VEHICLES = 30
ON_STRAIGHT = 500
WORLDS, DECISIONS = 256, 40
POOL_IDLE = 1
"""Action of EnvPool's ego that keeps speed and lane."""
MANY = 112
"""As many vehicles as can start in the twin, all within 250 m of the ego."""
ON_MERGE = 65
"""The vehicles on the road ``merge`` that correspond to its flow."""
NUMBERS = (5, 10, 30, 60, 120, 240)
FEW_RATIO = 0.7
"""The least ratio to bare libsumo that we want at 5 vehicles."""
Rate = Callable[[], float]


class Row(NamedTuple):
    """Two functions that measure a rate per second, and the least ratio and rate that we want."""

    name: str
    ours: Rate
    beside: Rate
    """The rival's measurement."""
    least_ratio: float | None = None
    least_ours: float = 0.0


def exploring(config: Config) -> Config:
    """Return the settings with a constant epsilon of 0.2."""
    return config.updated("learning", epsilon_start=0.2, epsilon_end=0.2)


def crowded(vehicles: int = VEHICLES, kind: str = "calm") -> Config:
    """Return the settings with so many vehicles of a kind, and a constant epsilon of 0.2."""
    config = Config().with_traffic(kind)
    return exploring(config.updated("traffic", vehicles_min=vehicles, vehicles_max=vehicles))


LEAST_RATIOS = {"paper": 0.9, "strict": 0.85}
"""The least ratio to bare libsumo that we want at 30 vehicles, by check."""


def env_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return rows of the environment's decisions per second beside bare libsumo's, by check."""
    rows = []
    for check, least in LEAST_RATIOS.items():
        config = crowded().updated("safety", check=check)
        rates = env_and_bare(config, load_driver(PRETRAINED), seeds, stack)
        rows.append(Row(f"environment, check {check} | bare libsumo", *rates, least, 2_000))
    return rows


def traffic_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return rows of decisions per second in traffic of our drivers beside traffic of SUMO's.

    The resets do not count: the episodes in ``hazards`` are shorter.
    """
    rates = {}
    for name in ("calm", "paper", "hazards"):
        config = crowded(kind=name)
        env = stack.enter_context(closing(made(config)))
        actions = recorded_actions(env, IdmDriver(config.safety), seeds)
        rates[name] = partial(drive_only, env, actions)
    return [Row(f"traffic {name} | calm", rates[name], rates["calm"], 0.8) for name in rates][1:]


def planner_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return rows of the planner's decisions per second beside those of its base policy."""
    rows = []
    for name in ("calm", "paper"):
        config = crowded(kind=name).updated("safety", check="strict")
        env = stack.enter_context(closing(made(config)))
        drivers = make_drivers(find_drivers(["planner", "pretrained"]), config).values()
        ours, beside = (partial(decide_only, env, driver, seeds[:1]) for driver in drivers)
        rows.append(Row(f"planner {name} | pretrained", ours, beside))
    return rows


def env_and_bare(
    config: Config, driver: Driver, seeds: Sequence[int], stack: ExitStack
) -> tuple[Rate, Rate]:
    """Return two measurements of a driver's episodes: with the environment, with bare libsumo.

    The environment is the one that users make, with its action masks.
    """
    env = stack.enter_context(closing(made(config)))
    return measurements(env, recorded_actions(env, driver, seeds))


def made(config: Config) -> HighwayEnv:
    """Return the environment as ``gymnasium.make`` makes it."""
    env: HighwayEnv = gymnasium.make("drl_av/Highway-v0", config=config)  # type: ignore[assignment]
    assert env is env.unwrapped  # no wrapper that the rival would not have to pay for
    return env


def measurements(env: HighwayEnv, actions: dict[int, list[int]]) -> tuple[Rate, Rate]:
    """Return two measurements of episodes: with the environment, with bare libsumo."""
    return partial(drive, env, actions), partial(step_bare, env, recorded_calls(env, actions))


def worlds_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return rows of decisions per second of many worlds of the twin.

    Beside them are the environment, and the worlds themselves: other kinds of traffic beside calm,
    more vehicles beside fewer on a road that is shorter by as much, ``merge`` beside a loop.
    """
    rows = []
    for check in LEAST_RATIOS:
        config = crowded().updated("safety", check=check)
        env = stack.enter_context(closing(HighwayEnv(config=config)))
        actions = recorded_actions(env, IdmDriver(config.safety), seeds)
        rates = worlds_rate(config, seeds[0], stack), partial(drive, env, actions)
        rows.append(Row(f"{WORLDS} worlds of the twin, check {check} | environment", *rates))
    kinds = {kind: worlds_rate(crowded(kind=kind), seeds[0], stack) for kind in SINGLE_PRESETS}
    calm = kinds.pop("calm")
    rows += [Row(f"{WORLDS} worlds of the twin, {k} | calm", kinds[k], calm) for k in kinds]
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    rates = {}
    for number in (VEHICLES, ON_MERGE, MANY):
        write_scenario(folder / str(number), ScenarioDescription(25.0 * number))
        config = crowded(number).updated("simulation", scenario=str(folder / str(number)))
        rates[number] = worlds_rate(config, seeds[0], stack)
    name = f"{WORLDS} worlds of the twin, {MANY} vehicles | {VEHICLES} vehicles"
    rows.append(Row(name, rates[MANY], rates[VEHICLES], VEHICLES / MANY / 1.5))
    merge = crowded(ON_MERGE).updated("simulation", scenario="merge")
    rate = worlds_rate(merge, seeds[0], stack)
    name = f"{WORLDS} worlds of the twin, merge, {ON_MERGE} vehicles | loop"
    return [*rows, Row(name, rate, rates[ON_MERGE])]


def worlds_rate(config: Config, seed: int, stack: ExitStack) -> Rate:
    """Return the measurement of ``WORLDS`` worlds of the twin on one thread."""
    worlds = stack.enter_context(closing(TwinVectorEnv(WORLDS, config=config, threads=1)))
    return partial(drive_worlds, worlds, seed)


def drive_worlds(worlds: TwinVectorEnv, seed: int) -> float:
    """Drive all worlds from the start of an episode; return their decisions per CPU second.

    Each ego accelerates where that is permitted, and brakes otherwise.
    """
    worlds.reset(seed=seed, options={"vehicles": worlds.config.traffic.vehicles_min})
    begun = time.process_time()
    for _ in range(DECISIONS):
        worlds.step(np.where(worlds.action_masks()[:, ACCELERATE], ACCELERATE, BRAKE))
    return WORLDS * DECISIONS / (time.process_time() - begun)


def envpool_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return rows of many worlds of the twin beside EnvPool's Highway-v0, per CPU second.

    EnvPool simulates at its default of 15 Hz, the twin at 2 Hz.
    """
    import envpool

    scene = {"lanes_count": 3, "vehicles_count": VEHICLES}
    pool = envpool.make(
        "Highway-v0", env_type="gymnasium", num_envs=WORLDS, num_threads=1, seed=seeds[0], **scene
    )
    ours, beside = worlds_rate(crowded(), seeds[0], stack), partial(drive_pool, pool)
    steps = Config().simulation.steps_per_decision, pool.config["simulation_frequency"]
    times = [partial(multiplied, *pair) for pair in zip((ours, beside), steps, strict=True)]
    name = f"{WORLDS} worlds of the twin | EnvPool"
    return [Row(name, ours, beside), Row(f"{name}, simulated steps", *times)]


def drive_pool(pool: Any) -> float:
    """Drive EnvPool's highways with one constant action; return their decisions per CPU second."""
    pool.reset()
    idle = np.full(WORLDS, POOL_IDLE, np.int32)
    begun = time.process_time()
    for _ in range(DECISIONS):
        pool.step(idle)
    return WORLDS * DECISIONS / (time.process_time() - begun)


def multiplied(rate: Rate, factor: float) -> float:
    """Measure a rate and multiply it."""
    return factor * rate()


def highway_env_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the row of the environment's decisions per second beside HighwayEnv's."""
    import highway_env  # noqa: F401 (registers its ids)

    ours, _ = env_rows(seeds, stack)
    scene = {"lanes_count": 3, "vehicles_count": VEHICLES, "policy_frequency": 1, "duration": 200}
    env = stack.enter_context(closing(gymnasium.make("highway-v0", config=scene)))
    keep = env.unwrapped.action_type.actions_indexes["IDLE"]  # type: ignore[attr-defined]
    rival = partial(drive_on, env, keep, seeds[:1])
    return [Row("environment | HighwayEnv", ours.ours, rival)]


def drive_on(env: gymnasium.Env[Any, Any], action: int, seeds: Sequence[int]) -> float:
    """Drive an environment with one constant action, and return its decisions per second."""
    begun, decisions = time.perf_counter(), 0
    for seed in seeds:
        env.reset(seed=seed)
        over = False
        while not over:
            _, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
            decisions += 1
    return decisions / (time.perf_counter() - begun)


def processes_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the row of decisions per second of two processes together beside one process.

    There is no row if the machine has one core.
    """
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [-1, -1]
    if len(cores) < 2:
        print("one core: no row for two processes", file=sys.stderr)
        return []
    context = multiprocessing.get_context("spawn")
    pipes = []
    for core in cores[:2]:
        pipe, far = context.Pipe()
        context.Process(target=work, args=(far, core, list(seeds)), daemon=True).start()
        stack.callback(pipe.send, False)
        pipes.append(pipe)
    for pipe in pipes:
        pipe.recv()

    def together(pipes: Sequence[Any]) -> float:
        for _ in range(2):  # a core that was idle is slow at first: the second drive counts
            begun = time.perf_counter()
            for pipe in pipes:
                pipe.send(True)
            decisions = sum(pipe.recv() for pipe in pipes)
            rate = decisions / (time.perf_counter() - begun)
        return float(rate)

    return [Row("two processes | one", partial(together, pipes), partial(together, pipes[:1]), 1.8)]


def work(pipe: "Connection[Any, Any]", core: int, seeds: Sequence[int]) -> None:
    """Run in a worker process: for each True on ``pipe``, drive and send the number of decisions.

    The worker sends True when it is ready, and ends after it receives False. It runs on the CPU
    ``core``; -1 means any.
    """
    if core >= 0:
        os.sched_setaffinity(0, {core})
    with closing(HighwayEnv(config=crowded())) as env:
        actions = recorded_actions(env, IdmDriver(env.config.safety), seeds)
        pipe.send(True)
        while pipe.recv():
            drive(env, actions)
            pipe.send(sum(map(len, actions.values())))


def scaling_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return rows of decisions per second with 5 to 240 vehicles, placed evenly.

    From 30 vehicles on there are 60 on each kilometre.
    """
    home, rows = Path(stack.enter_context(tempfile.TemporaryDirectory())), []
    for number in NUMBERS:
        folder = home / str(number)
        write_scenario(folder, even_traffic(number))
        config = crowded(number).updated("simulation", scenario=str(folder))
        rates = env_and_bare(config, IdmDriver(config.safety), seeds[:2], stack)
        least = FEW_RATIO if number == min(NUMBERS) else None
        rows.append(Row(f"{number} vehicles", *rates, least))
    return rows


def even_traffic(number: int) -> ScenarioDescription:
    """Return a scenario with this number of vehicles and the ego, evenly over three lanes.

    The loop is 500 m long for each 30 vehicles, at least 500 m.
    """
    circumference_m = 500.0 * max(1.0, number / VEHICLES)
    pitch_m = circumference_m / math.ceil((number + 1) / 3)
    vehicles = (
        PlacedVehicle(
            f"vehicle{i}" if i else "ego",
            i % 3,
            (i // 3 + i % 3 / 3) * pitch_m,
            15.0,
            20.0 + i % 13,
        )
        for i in range(number + 1)
    )
    return ScenarioDescription(circumference_m, vehicles=tuple(vehicles))


def straight_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the row of decisions per second on a straight road, which vehicles enter and leave."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()), "straight")
    write_scenario(folder, long_road())
    config = crowded(ON_STRAIGHT).updated("simulation", scenario=str(folder))
    rates = env_and_bare(config, IdmDriver(config.safety), seeds[:1], stack)
    return [Row(f"straight road, {ON_STRAIGHT} vehicles | bare libsumo", *rates)]


def long_road() -> StraightDescription:
    """Return a straight road whose flow corresponds to ``ON_STRAIGHT`` vehicles.

    1,000 vehicles/h in each of three lanes at 20 m/s are 500 on 12 km. Vehicles are on the road
    from 300 m behind the ego's start to 305 m beyond the end of its way.
    """
    return StraightDescription(flow_per_h=1000.0, length_m=12_000.0 - 300.0 - 305.0)


def roads_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return rows of decisions per second on open roads beside a loop with as many vehicles.

    A second row of each road does the same with bare libsumo. The number of vehicles is the mean
    number on the open road. The loop has 60 of them on each kilometre, as in the row ``env``.
    """
    home, rows = Path(stack.enter_context(tempfile.TemporaryDirectory())), []

    def recorded(folder: Path, number: int) -> tuple[HighwayEnv, dict[int, list[int]]]:
        config = crowded(number).updated("simulation", scenario=str(folder))
        config = config.updated("safety", check="strict")
        env = stack.enter_context(closing(HighwayEnv(config=config)))
        return env, recorded_actions(env, rule_driver("gap-mobil", config), seeds)

    for kind in ("straight", "merge", "exit", "ramp_to_ramp"):
        write_scenario(home / kind, ROAD_TYPES[kind]())
        with closing(HighwayEnv(home / kind)) as env:
            usual = env.simulation.fleet.default_vehicle_count
        assert usual is not None
        open_road = recorded(home / kind, usual)
        number = round(mean_vehicles(*open_road))
        loop = home / f"loop_{kind}"
        write_scenario(loop, ScenarioDescription(500.0 * number / VEHICLES))
        pairs = measurements(*open_road), measurements(*recorded(loop, number))
        ours, bare = zip(*pairs, strict=True)
        rows.append(Row(f"{kind}, {number} vehicles | loop", *ours, least_ratio=0.9))
        rows.append(Row(f"{kind}, {number} vehicles | loop, bare libsumo", *bare))
    return rows
