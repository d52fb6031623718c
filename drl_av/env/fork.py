"""Copies a running episode, in SUMO or in the twin, into worlds of the twin, for search."""

from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from drl_av.config import Config
from drl_av.driving.scene import Scene
from drl_av.env.episode_start import TrafficSetup
from drl_av.env.transition import RouteOutcome
from drl_av.env.twin_episodes import look_all
from drl_av.env.twin_simulation import TwinSimulation
from drl_av.env.vector import TwinVectorEnv
from drl_av.errors import ConfigError
from drl_av.random_streams import kind_of_traffic
from drl_av.road.snapshot import EGO
from drl_av.twin.copying import copy_scene
from drl_av.twin.following import STEP_S
from drl_av.twin.traffic import IN_SUMO
from drl_av.twin.worlds import (
    BRAKING,
    DRIVER_STATE,
    LATERAL_SPEED_M_S,
    REQUEST_END,
    STEP,
)


def twin_of(whose: str, instead: str, config: Config, **arguments: Any) -> TwinVectorEnv:
    """Return worlds of the twin, which never begin anew, for a search in an episode.

    Raises:
        ConfigError: the twin cannot do what the settings ask; the message says ``whose`` worlds
            these are, and what the user can do ``instead``.
    """
    try:
        return TwinVectorEnv(config=config, autoreset_mode=AutoresetMode.DISABLED, **arguments)
    except ConfigError as error:
        reason = str(error).replace(IN_SUMO, instead)
        raise ConfigError(f"{whose} in the twin. {reason}") from error


def copy_episode(
    twin: TwinVectorEnv,
    traffic: TrafficSetup,
    route: RouteOutcome,
    scene: Scene,
    seed: int,
    so_far: tuple[int, float, int],
) -> None:
    """Let the first world of ``twin`` go on from a scene.

    ``seed`` is the traffic seed of the episode that runs in ``traffic``, whose settings are those
    of ``twin``, and ``route`` is the outcome of its ego's route. ``so_far`` holds its decisions,
    the sum of the speeds after each, and how many of them the check changed. Vehicles that have
    left an open road in SUMO are not copied.
    """
    simulation, fleet, decisions = traffic.simulation, traffic.simulation.fleet, so_far[0]
    shot, vehicles = scene.snapshot, len(scene.snapshot.ids) - 1
    if decisions == 0:
        twin.reset(seed=seed, options={"vehicles": vehicles})
        return
    if not twin.road.is_loop:
        if twin.seeds[0] != seed:
            twin.reset(seed=seed, options={"vehicles": 0})
        twin.fleets[0], twin.routes[0] = fleet.copied(None, shot.time_s), copy(route)
        twin.vehicles[0], twin.ways[0] = vehicles, route.reached
        twin.make_room(len(shot.ids), 0)
    elif (twin.seeds[0], twin.vehicles[0]) != (seed, vehicles):
        twin.reset(seed=seed, options={"vehicles": vehicles})
    if isinstance(simulation, TwinSimulation):
        twin.make_room(simulation.world.x.shape[-1], 0)
    world, net, episodes = twin.world(0), twin.task.net, twin.episodes
    if isinstance(simulation, TwinSimulation):
        for ours, its in zip(world, simulation.world, strict=True):
            ours[..., : its.shape[-1]] = its
    else:
        where = simulation.scenario, kind_of_traffic(seed, twin.config.per_traffic_preset)
        requests = {
            row: (lane, round((end_s - shot.time_s) / STEP_S))
            for row, (lane, end_s) in simulation.requests.items()
            if lane >= 0
        }
        seen = shot, requests, simulation.speeds_chosen()
        population = fleet.population
        if not twin.road.is_loop:
            front_m = shot.s_m + shot.length_m / 2
            lane = np.array([*map(simulation.road.lane_of, shot.y_m.tolist())])
            population = replace(fleet.present, front_m=front_m, lane=lane)
        copy_scene(world, net, population, fleet.driver_models, *seen, *where)
        steps = round(shot.time_s / STEP_S)
        world.near[STEP] = steps
        world.z[REQUEST_END] += steps
    if twin.road.is_loop:  # only SUMO drives on an open road
        state, braking = traffic.drivers.memory
        world.z[DRIVER_STATE, : vehicles + 1], world.z[BRAKING, : vehicles + 1] = state, braking
    last = episodes.next_event[0, 1]
    episodes.next_event[0, 0] = np.searchsorted(episodes.events[0, :last, 0], decisions)
    episodes.sums[0] = so_far[1:]
    place_ego(twin, scene, decisions)


def place_ego(twin: TwinVectorEnv, scene: Scene, decisions: int) -> None:
    """Let the ego of the first world go on from a scene, which it sees, after so many decisions.

    The vehicles are there already.
    """
    episodes, change, lane = twin.episodes, scene.lane_change, scene.affordances.lane
    twin.world(0).x[LATERAL_SPEED_M_S, EGO] = scene.snapshot.lateral_speed_m_s[EGO]
    episodes.lanes[0] = (lane, lane) if change is None else change[:2]
    episodes.heading_rad[0] = 0.0 if change is None else change.heading_rad
    episodes.decisions[0] = decisions
    look_all(twin.worlds, episodes, twin.task, np.zeros(1, np.int64))
