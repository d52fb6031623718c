"""Episodes that ``benchmark.py`` drives over and over: by the environment, by bare libsumo."""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any
from unittest.mock import patch

from drl_av.env.highway import HighwayEnv

COMMANDS = ("setSpeed", "changeSublane", "changeLaneRelative")
"""The functions of ``sumo.vehicle`` with which the environment moves SUMO."""
STEP = "simulationStep"
Call = partial[Any]


def start(env: HighwayEnv, seed: int) -> tuple[Any, dict[str, Any]]:
    """Start the episode of a traffic seed with as many vehicles as every episode has."""
    return env.reset(seed=seed, options={"vehicles": env.config.traffic.vehicles_min})


def recorded(env: HighwayEnv, driver: Any, seeds: Sequence[int]) -> dict[int, list[int]]:
    """What the driver does by the episode's seed, so that the driver itself is not timed."""
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
    """Decisions a second of the environment."""
    begun = time.perf_counter()
    for seed, row in actions.items():
        start(env, seed)
        for action in row:
            env.step(action)
    return sum(map(len, actions.values())) / (time.perf_counter() - begun)


def commanded(env: HighwayEnv, actions: dict[int, list[int]]) -> dict[int, list[Call]]:
    """Every call with which the environment moves SUMO in these episodes, by the episode's seed."""
    calls: dict[int, list[Call]] = {}
    for seed, row in actions.items():
        start(env, seed)
        sumo = env.simulation._sumo
        functions = [(sumo.vehicle, name) for name in COMMANDS] + [(sumo, STEP)]
        calls[seed] = []
        with ExitStack() as stack:
            for owner, name in functions:
                noting = partial(note, calls[seed], getattr(owner, name))
                stack.enter_context(patch.object(owner, name, noting))
            for action in row:
                env.step(action)
    return calls


def note(calls: list[Call], function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function of libsumo, and remember the call."""
    calls.append(partial(function, *arguments))
    return function(*arguments)


def step_bare(env: HighwayEnv, calls: dict[int, list[Call]]) -> float:
    """Decisions a second of libsumo alone: the same traffic, nobody looks at it or decides."""
    config = env.config
    begun, steps = time.perf_counter(), 0
    for seed, row in calls.items():
        env.simulation.reset(seed, config.traffic.vehicles_min)
        for call in row:
            call()
        steps += sum(call.func.__name__ == STEP for call in row)
    return steps / config.simulation.steps_per_decision / (time.perf_counter() - begun)
