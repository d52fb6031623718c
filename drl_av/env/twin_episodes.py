"""The episodes of many worlds: one decision of each ego, with SUMO's traffic around it."""

from typing import NamedTuple

import numpy as np

from drl_av.arrays import Float32Array, FloatArray, IntArray
from drl_av.compiled import borrowing, compiled, inlined
from drl_av.config import Config, RewardConfig, SafetyConfig, StrictConfig
from drl_av.drivers.background.traffic import Scratch, TrafficNumbers, scratch_of, traffic_numbers
from drl_av.driving.actions import EgoNumbers, ego_numbers
from drl_av.driving.affordances import CODES, FRONT, VALUES
from drl_av.driving.maneuver import plan_into
from drl_av.driving.observation_scale import ObservationScale, ScaleArrays
from drl_av.env.scene_values import compute_values
from drl_av.errors import ConfigError
from drl_av.road.road import RoadNumbers, holds, road_numbers
from drl_av.road.sweep import HIT_EDGE, NO_CONTACT, swept_collision
from drl_av.safety import named_check
from drl_av.safety.paper import before_lane_ends, paper_verdicts
from drl_av.safety.strict import strict_verdicts
from drl_av.scenarios.folder import Scenario
from drl_av.twin.commands import drive_traffic, happen
from drl_av.twin.following import STEP_S
from drl_av.twin.step import sumo_step
from drl_av.twin.traffic import IN_SUMO, net_of
from drl_av.twin.worlds import (
    ASIDE_M,
    COUNT,
    DRIVER_COUNT,
    FRONT_M,
    LANE,
    LATERAL_SPEED_M_S,
    LENGTH_M,
    PRESENT,
    SPEED_M_S,
    WIDTH_M,
    Net,
    World,
    Worlds,
)

PERMIT_ALL, PAPER, STRICT = range(3)
"""The numbers of the safety checks."""
CHECK_NUMBERS = {"permit_all": PERMIT_ALL, "paper": PAPER, "strict": STRICT}


class Episodes(NamedTuple):
    """What the egos of all worlds see and have done; the first axis of each array is the world."""

    scene: FloatArray
    """Shape (worlds, 6, vehicles): the arrays of a snapshot, from s_m to width_m."""
    before: FloatArray
    """Shape (worlds, 2, vehicles): s_m and y_m one step earlier."""
    plan: FloatArray
    """Shape (worlds, 3, steps of a decision): the ego's speed, y and lateral speed."""
    values: FloatArray
    """Shape (worlds, 30), as ``indicators`` fills it; the first 27 are the indicators."""
    codes: IntArray
    """Shape (worlds, 10), likewise."""
    observation: Float32Array
    """Shape (worlds, 27)."""
    executed: IntArray
    """Shape (worlds, 12): the action that the check executes for each proposed one."""
    rules: IntArray
    """Shape (worlds, 12): the rules that replace each proposed action."""
    lanes: IntArray
    """Shape (worlds, 2): the lanes of the lane change in progress, equal if there is none."""
    heading_rad: FloatArray
    """Shape (worlds,)."""
    events: IntArray
    """Shape (worlds, most events, 3): the random events, as in ``draw_events``."""
    next_event: IntArray
    """Shape (worlds, 2): the number of the next random event, and of all of them."""
    decisions: IntArray
    """Shape (worlds,): decisions since the start."""
    sums: FloatArray
    """Shape (worlds, 2): the sum of the speeds after each decision, and how often a rule held."""
    terms: FloatArray
    """Shape (worlds, 3): the reward terms r_v, r_y, r_x of the present scene."""
    collision: IntArray
    """Shape (worlds, 2): the kind of the ego's collision in the last decision, or ``NO_CONTACT``;
    and the row of the other vehicle."""


class Task(NamedTuple):
    """What all worlds have in common: the road and the settings, as numbers."""

    net: Net
    road: RoadNumbers
    range_m: float
    scale: ScaleArrays
    reward: RewardConfig
    safety: SafetyConfig
    strict: StrictConfig
    ego: EgoNumbers
    check: int
    traffic: TrafficNumbers


def task_of(scenario: Scenario, config: Config) -> Task:
    """Return the numbers of a scenario and a config.

    Raises:
        ConfigError: the twin cannot do what the settings ask.
    """
    road, net = scenario.road, net_of(scenario, config)
    check = config.safety.check
    if ":" not in check:
        named_check(config, scenario.vehicle_types, road)  # refuses what it must
    if check not in CHECK_NUMBERS:
        raise ConfigError(
            f"The twin has the checks {', '.join(CHECK_NUMBERS)}, but not {check}: name one of "
            f"them, or {IN_SUMO}."
        )
    scale = ObservationScale(config.observation, config.ego.max_speed_m_s, road)
    return Task(
        net=net,
        road=road_numbers(road),
        range_m=float(config.observation.range_m),
        scale=scale.arrays,
        reward=config.reward.numbers,
        safety=config.safety.numbers,
        strict=config.strict.numbers,
        ego=ego_numbers(config.ego, config.simulation),
        check=CHECK_NUMBERS[config.safety.check],
        traffic=traffic_numbers(config, road, scenario.vehicle_types),
    )


def empty_episodes(worlds: int, vehicles: int, steps: int, events: int) -> Episodes:
    """Return the arrays of episodes for up to ``vehicles`` vehicles and ``events`` events."""
    return Episodes(
        scene=np.zeros((worlds, 6, vehicles)),
        before=np.zeros((worlds, 2, vehicles)),
        plan=np.zeros((worlds, 3, steps)),
        values=np.zeros((worlds, VALUES)),
        codes=np.zeros((worlds, CODES), np.int64),
        observation=np.zeros((worlds, 27), np.float32),
        executed=np.zeros((worlds, 12), np.int64),
        rules=np.zeros((worlds, 12), np.int64),
        lanes=np.zeros((worlds, 2), np.int64),
        heading_rad=np.zeros(worlds),
        events=np.zeros((worlds, events, 3), np.int64),
        next_event=np.zeros((worlds, 2), np.int64),
        decisions=np.zeros(worlds, np.int64),
        sums=np.zeros((worlds, 2)),
        terms=np.zeros((worlds, 3)),
        collision=np.full((worlds, 2), NO_CONTACT, np.int64),
    )


@borrowing
def look_all(worlds: Worlds, episodes: Episodes, task: Task, rows: IntArray) -> None:
    """Compute the present scene of the worlds ``rows``."""
    for w in rows:
        world = World(worlds.x[w], worlds.z[w], worlds.notes[w], worlds.near[w])
        read_scene(world, task.net, episodes.scene[w])
        look(episodes, task, w, world.near[PRESENT])


@compiled
def decide_all(
    worlds: Worlds, episodes: Episodes, task: Task, rows: IntArray, actions: IntArray
) -> None:
    """Execute the proposed actions, shape (worlds,), in the worlds ``rows``."""
    scratch = scratch_of(task.traffic, worlds.x.shape[2])
    for w in rows:
        decide(worlds, episodes, task, w, actions[w], scratch)


@borrowing
def decide(
    worlds: Worlds, episodes: Episodes, task: Task, w: int, action: int, scratch: Scratch
) -> None:
    """Execute one decision in the world ``w``; its results are in ``episodes``."""
    world = World(worlds.x[w], worlds.z[w], worlds.notes[w], worlds.near[w])
    net, scene, plan, lanes = task.net, episodes.scene[w], episodes.plan[w], episodes.lanes[w]
    seen, going = (episodes.values[w], episodes.codes[w]), episodes.executed[w, action]
    begun = lanes[0], lanes[1], episodes.heading_rad[w]
    into = plan[0], plan[1], plan[2]
    origin, target, heading_rad = plan_into(
        *seen, going, *begun, net.lane_m, task.road.speed_limits, task.ego, *into
    )
    let_events_happen(world, net, episodes, w)
    if world.near[DRIVER_COUNT]:
        drive_traffic(world, net, scene, task.traffic, scratch, plan.shape[1])
    episodes.collision[w, 0] = NO_CONTACT
    for step in range(plan.shape[1]):
        command = plan[0, step], plan[1, step], plan[2, step]
        kind, row = advance(world, net, task.road, scene, episodes.before[w], *command)
        if kind != NO_CONTACT:
            episodes.collision[w, 0], episodes.collision[w, 1] = kind, row
            break
    lanes[0], lanes[1], episodes.heading_rad[w] = origin, target, heading_rad
    episodes.decisions[w] += 1
    episodes.sums[w, 0] += scene[2, 0]
    episodes.sums[w, 1] += episodes.rules[w, action] != 0
    look(episodes, task, w, world.near[PRESENT])


@borrowing
def advance(
    world: World,
    net: Net,
    road: RoadNumbers,
    scene: FloatArray,
    before: FloatArray,
    speed_m_s: float,
    y_m: float,
    lateral_speed_m_s: float,
) -> tuple[int, int]:
    """Execute one command of the ego in a SUMO step; return its collision and the other's row.

    ``scene`` becomes that after the step, and ``before`` holds the positions before it. The
    collision is a number of ``KINDS``, or ``NO_CONTACT``.
    """
    n = world.near[COUNT]
    for i in range(n):
        before[0, i], before[1, i] = scene[0, i], scene[1, i]
    if y_m != scene[1, 0] or len(road.partial_lanes):
        front_m = scene[0, 0] + 0.5 * scene[4, 0] + speed_m_s * STEP_S
        if not holds(y_m, scene[5, 0], front_m, road):
            return HIT_EDGE, 0
    sumo_step(world, net, road, speed_m_s, y_m)
    read_scene(world, net, scene)
    world.x[LATERAL_SPEED_M_S, 0] = lateral_speed_m_s
    scene[3, 0] = lateral_speed_m_s
    moved, bodies = (scene[0][:n], scene[1][:n]), (scene[4][:n], scene[5][:n])
    row, kind, _ = swept_collision(before[0][:n], before[1][:n], *moved, *bodies, net.lap_m)
    return kind, row


@borrowing
def let_events_happen(world: World, net: Net, episodes: Episodes, w: int) -> None:
    """Let the random events of the present decision happen."""
    number, last = episodes.next_event[w, 0], episodes.next_event[w, 1]
    while number < last and episodes.events[w, number, 0] <= episodes.decisions[w]:
        happen(world, net, episodes.events[w, number, 1], episodes.events[w, number, 2])
        number += 1
    episodes.next_event[w, 0] = number


@inlined
def read_scene(world: World, net: Net, scene: FloatArray) -> None:
    """Write the state of all vehicles as the arrays of a snapshot, shape (6, vehicles)."""
    for i in range(world.near[COUNT]):
        s_m = world.x[FRONT_M, i] - 0.5 * world.x[LENGTH_M, i]
        scene[0, i] = s_m if s_m >= 0 else s_m + net.lap_m
        scene[1, i] = world.z[LANE, i] * net.lane_m + world.x[ASIDE_M, i]
        scene[2, i] = world.x[SPEED_M_S, i]
        scene[3, i] = world.x[LATERAL_SPEED_M_S, i]
        scene[4, i] = world.x[LENGTH_M, i]
        scene[5, i] = world.x[WIDTH_M, i]


@borrowing
def look(episodes: Episodes, task: Task, w: int, n: int) -> None:
    """Compute indicators, observation, reward terms and verdicts of the present scene."""
    scene, values, codes = episodes.scene[w], episodes.values[w], episodes.codes[w]
    state = scene[0][:n], scene[1][:n], scene[2][:n], scene[3][:n], scene[4][:n], scene[5][:n]
    given = task.scale, task.reward, task.safety
    r_v, r_y, r_x = compute_values(
        state, task.road, task.range_m, *given, values, codes, episodes.observation[w]
    )
    episodes.terms[w, 0], episodes.terms[w, 1], episodes.terms[w, 2] = r_v, r_y, r_x
    executed, rules = episodes.executed[w], episodes.rules[w]
    lanes = episodes.lanes[w, 0], episodes.lanes[w, 1]
    ground = task.net.lap_m, task.net.lane_m, task.road.barriers, values[FRONT]
    if task.check == PAPER and len(task.road.barriers):
        settings = task.safety, task.strict, task.ego
        before_lane_ends(state, values, codes, lanes, ground, *settings, executed, rules)
    elif task.check == PAPER:
        paper_verdicts(values, codes, lanes, task.safety, executed, rules)
    elif task.check == STRICT:
        strict_verdicts(state, codes, lanes, ground, task.strict, task.ego, executed, rules)
    else:
        for number in range(12):
            executed[number], rules[number] = number, 0
