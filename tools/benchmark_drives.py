"""Drives the episodes of ``benchmark.py``, with the environment and with bare libsumo."""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any
from unittest.mock import patch

from drl_av.drivers.driver import Driver
from drl_av.env.highway import HighwayEnv

COMMANDS = ("setSpeed", "changeSublane", "changeLaneRelative")
"""The functions of ``sumo.vehicle`` with which the environment commands vehicles."""
ENTERING = (
    *("add", "moveTo", "setLength", "setWidth", "setShapeClass", "setPreviousSpeed", "setTau"),
    *("setAccel", "setParameter", "setMaxSpeed"),
)
"""The functions of ``sumo.vehicle`` with which the environment adds vehicles to an open road."""
STEP = "simulationStep"
Call = partial[Any]


def start(env: HighwayEnv, seed: int) -> tuple[Any, dict[str, Any]]:
    """Reset the environment to a traffic seed, with ``traffic.vehicles_min`` vehicles."""
    return env.reset(seed=seed, options={"vehicles": env.config.traffic.vehicles_min})


def recorded_actions(env: HighwayEnv, driver: Any, seeds: Sequence[int]) -> dict[int, list[int]]:
    """Drive each seed's episode once; return the driver's action numbers by seed.

    They are executed again later, so that the driver itself is not timed.
    """
    actions: dict[int, list[int]] = {}
    for seed in seeds:
        observation, _ = start(env, seed)
        actions[seed], over = [], False
        while not over:
            actions[seed].append(driver.act(env.scene, observation).number)
            observation, _, terminated, truncated, _ = env.step(actions[seed][-1])
            over = terminated or truncated
    return actions


def drive(env: HighwayEnv, actions: dict[int, list[int]]) -> float:
    """Execute the actions of each episode, and return the environment's decisions per second."""
    begun = time.perf_counter()
    drive_only(env, actions)
    return sum(map(len, actions.values())) / (time.perf_counter() - begun)


def drive_only(env: HighwayEnv, actions: dict[int, list[int]]) -> float:
    """Execute the actions of each episode; return the decisions per second, without the resets."""
    driven_s = 0.0
    for seed, row in actions.items():
        start(env, seed)
        begun = time.perf_counter()
        for action in row:
            env.step(action)
        driven_s += time.perf_counter() - begun
    return sum(map(len, actions.values())) / driven_s


def decide_only(env: HighwayEnv, driver: Driver, seeds: Sequence[int]) -> float:
    """Drive an episode of each seed; return the driver's decisions per second of its own."""
    decided_s, decisions = 0.0, 0
    for seed in seeds:
        observation, _ = start(env, seed)
        driver.start(seed)
        over = False
        while not over:
            begun = time.perf_counter()
            action = driver.act(env.scene, observation)
            decided_s += time.perf_counter() - begun
            observation, _, terminated, truncated, _ = env.step(action.number)
            decisions, over = decisions + 1, terminated or truncated
    return decisions / decided_s


def mean_vehicles(env: HighwayEnv, actions: dict[int, list[int]]) -> float:
    """Execute the actions of each episode; return the mean number of other vehicles on the road."""
    numbers = []
    for seed, row in actions.items():
        start(env, seed)
        for action in row:
            env.step(action)
            numbers.append(len(env.scene.snapshot.ids) - 1)
    return sum(numbers) / len(numbers)


def recorded_calls(env: HighwayEnv, actions: dict[int, list[int]]) -> dict[int, list[Call]]:
    """Execute the actions of each episode; return the environment's calls of libsumo by seed."""
    calls: dict[int, list[Call]] = {}
    for seed, row in actions.items():
        start(env, seed)
        sumo = env.simulation._sumo
        functions = [(sumo.vehicle, name) for name in (*COMMANDS, *ENTERING)] + [(sumo, STEP)]
        calls[seed], requests = [], env.simulation._requests
        requests._set_speed = partial(record_call, calls[seed], requests._set_speed)
        with ExitStack() as stack:
            for owner, name in functions:
                recording = partial(record_call, calls[seed], getattr(owner, name))
                stack.enter_context(patch.object(owner, name, recording))
            for action in row:
                env.step(action)
    return calls


def record_call(
    calls: list[Call], function: Callable[..., Any], *arguments: Any, **named: Any
) -> Any:
    """Call a function of libsumo, append the call to ``calls``, and return its result."""
    calls.append(partial(function, *arguments, **named))
    return function(*arguments, **named)


def step_bare(env: HighwayEnv, calls: dict[int, list[Call]]) -> float:
    """Repeat the calls with libsumo alone, in the same traffic; return decisions per second."""
    config = env.config
    begun, steps = time.perf_counter(), 0
    for seed, row in calls.items():
        env.simulation.reset(seed, config.traffic.vehicles_min)
        for call in row:
            call()
        steps += sum(call.func.__name__ == STEP for call in row)
    return steps / config.simulation.steps_per_decision / (time.perf_counter() - begun)
