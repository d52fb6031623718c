"""Inputs of ``verification.fuzz`` that start SUMO and drive a few decisions.

Each input is tried in its own process, because SUMO can crash.
"""

import multiprocessing
import random
import re
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import Field, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot
from drl_av.scenarios.custom_vehicle_types import CAR_FOLLOWING_MODELS, CustomVehicleType
from drl_av.scenarios.folder import find_scenario, shipped_scenarios, write_scenario
from drl_av.scenarios.road_description import PlacedVehicle
from drl_av.scenarios.road_types import ROAD_TYPES
from drl_av.simulation.start_sumo import connection

Attempt = Callable[[random.Random, Path], None]
DECISIONS = 4
LIMIT_S = 120
"""An input that takes longer counts as a hang."""
DRIVEN = ("simulation", "traffic", "ego", "safety", "strict", "finite_state", "level_0", "reward")
"""The sections of the config that change how an episode is driven."""
NUMBER = re.compile(rb"(?<![\w.])-?\d+\.?\d*(?![\w.])")
ATTRIBUTE = re.compile(rb'\b([A-Za-z]+)="([^"]*)"')
NUMBERS = (b"0", b"-1", b"1", b"0.001", b"2.5", b"19", b"1000", b"-0.0", b"1e9", b"nan")


def value(item: "Field[Any]", rng: random.Random) -> Any:
    """Return a random value for the setting ``item``: mostly a bound, or between the bounds.

    A number without bounds keeps its default.
    """
    usual: Any = item.default
    low, high = item.metadata.get("low"), item.metadata.get("high")
    if item.metadata.get("choices"):
        return rng.choice(item.metadata["choices"])
    if isinstance(usual, bool):
        return rng.random() < 0.5
    if low is None:
        return usual
    high = max(low + 1, 2 * usual) if high is None else high
    drawn = rng.choice([low, high, rng.uniform(low, high), usual * rng.uniform(0.5, 2)])
    return round(drawn) if isinstance(usual, int) else float(drawn)


def config(rng: random.Random) -> Config:
    """Return a config with one to four changed settings; raises ConfigError if one is refused."""
    found = Config()
    for _ in range(rng.randint(1, 4)):
        section = rng.choice(DRIVEN)
        items = [item for item in fields(getattr(found, section)) if item.name != "scenario"]
        item = rng.choice(items)
        found = found.updated(section, **{item.name: value(item, rng)})
    return found


def description(rng: random.Random) -> Any:
    """Return a random description of a scenario of any kind.

    Some descriptions place their vehicles exactly; others define their own vehicle types.
    """
    name = rng.choice(list(ROAD_TYPES))
    kind = ROAD_TYPES[name]
    items = [item for item in fields(kind) if item.metadata.get("low") is not None]
    given: dict[str, Any] = route() if name == "imported" else {}
    given |= {item.name: value(item, rng) for item in rng.sample(items, rng.randint(0, 4))}
    if rng.random() < 0.3:
        names = ["ego", *(f"v{number}" for number in range(rng.randint(0, 4)))]
        given["vehicles"] = tuple(_placed(name, rng) for name in names)
    elif rng.random() < 0.4 and any(item.name == "vehicle_types" for item in fields(kind)):
        choices: list[Any] = [(0.0, 0.3, 0.5, 1.0), (1.0, 5.0, 18.0, 25.0), (0.5, 1.8, 2.6, 5.0)]
        given["vehicle_types"] = tuple(
            CustomVehicleType(f"own{number}", *map(rng.choice, (*choices, [*CAR_FOLLOWING_MODELS])))
            for number in range(rng.randint(1, 3))
        )
    return kind(**given)


def route() -> dict[str, Any]:
    """Return the settings of an imported road: a network that ships, and a route through it."""
    net = find_scenario("merge") / "highway.net.xml"
    return {"net": str(net), "from_edge": "before", "to_edge": "after"}


def _placed(name: str, rng: random.Random) -> PlacedVehicle:
    return PlacedVehicle(
        name,
        rng.randint(0, 3),
        rng.choice([0.0, rng.uniform(0, 500), rng.uniform(250, 700)]),
        rng.choice([0.0, rng.uniform(0, 40), 100.0]),
        rng.choice([0.1, 30.0, 100.0]),
    )


def drive(env: HighwayEnv, rng: random.Random) -> None:
    """Drive a few random decisions; raises AssertionError if any number is impossible."""
    observation, info = env.reset(seed=rng.randrange(2**31))
    for _ in range(DECISIONS):
        assert env.observation_space.contains(observation), observation
        require_sense(env.scene.snapshot, env.road)
        observation, reward, terminated, truncated, info = env.step(rng.randrange(12))
        assert np.isfinite([reward, *info["rewards"].values()]).all(), (reward, info["rewards"])
        if terminated or truncated:
            break
    assert env.observation_space.contains(observation), observation
    require_sense(env.scene.snapshot, env.road)


def require_sense(shot: Snapshot, road: Road) -> None:
    """Raise AssertionError unless all numbers are finite and all vehicles are on the road."""
    numbers = (shot.s_m, shot.y_m, shot.speed_m_s, shot.lateral_speed_m_s)
    assert np.isfinite(numbers).all(), shot
    assert len(set(shot.ids)) == len(shot.ids), shot.ids
    assert ((shot.s_m >= 0) & (shot.s_m < road.lap_m)).all(), shot.s_m
    assert ((shot.speed_m_s >= 0) & (shot.speed_m_s < 110)).all(), shot.speed_m_s
    half_m = road.lane_width_m / 2
    left_m = road.lane_width_m * len(road.open_lanes) - half_m
    assert ((shot.y_m > -half_m) & (shot.y_m < left_m)).all(), shot.y_m


def positions(scenario: Path) -> bytes:
    """Return the positions of all vehicles of a scenario after three decisions, as bytes."""
    with closing(HighwayEnv(scenario, safety_check="permit_all")) as env:
        env.reset(seed=3)
        for action in (1, 8, 8):
            env.step(action)
        return np.stack((env.scene.snapshot.s_m, env.scene.snapshot.y_m)).tobytes()


original_positions = cache(positions)
"""The function ``positions`` with a cache, for scenarios whose files do not change."""


def driven_config(rng: random.Random, folder: Path) -> None:
    """Drive a shipped scenario with a mutated config."""
    scenario = rng.choice(sorted(shipped_scenarios()))
    with closing(HighwayEnv(scenario, config=config(rng))) as env:
        drive(env, rng)


def driven_scenario(rng: random.Random, folder: Path) -> None:
    """Drive a new scenario; in half the cases its files are changed by hand.

    The changes replace a number, delete, repeat or exchange lines, or give an attribute the value
    that it has on another line.
    """
    home = folder / "scenario"
    write_scenario(home, description(rng))
    if rng.random() < 0.5:
        (home / "SHA256SUMS").unlink()
        for _ in range(rng.randint(1, 3)):
            file = rng.choice(sorted(home.iterdir()))
            change = rng.choice((_renumbered, _rearranged))
            file.write_bytes(change(file.read_bytes(), rng))
    with closing(HighwayEnv(home)) as env:
        drive(env, rng)


def _renumbered(data: bytes, rng: random.Random) -> bytes:
    found = list(NUMBER.finditer(data))
    if not found:
        return data
    place = rng.choice(found)
    return data[: place.start()] + rng.choice(NUMBERS) + data[place.end() :]


def _rearranged(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    here, there = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(4)
    if kind == 0:
        del lines[here]
    elif kind == 1:
        lines.insert(there, lines[here])
    elif kind == 2:
        lines[here], lines[there] = lines[there], lines[here]
    elif found := list(ATTRIBUTE.finditer(lines[here])):
        name, value = (rng.choice(found)[number] for number in (1, 2))
        others = re.findall(rb"\b" + name + rb'="([^"]*)"', data)
        lines[here] = lines[here].replace(name + b'="' + value, name + b'="' + rng.choice(others))
    return b"".join(lines)


def apart(attempt: Attempt) -> Attempt:
    """Return a function that runs ``attempt`` in its own process.

    The function raises what ``attempt`` raises, and AssertionError if the process crashes or hangs.
    """
    context = multiprocessing.get_context("fork")
    connection(gui=False)  # imports libsumo once, not in each process

    def tried(rng: random.Random, folder: Path) -> None:
        with ProcessPoolExecutor(1, context, signal.alarm, (LIMIT_S,)) as pool:
            try:
                pool.submit(attempt, rng, folder).result()
            except BrokenProcessPool as error:
                text = f"its process crashed, or took longer than {LIMIT_S} s"
                raise AssertionError(text) from error

    return tried
