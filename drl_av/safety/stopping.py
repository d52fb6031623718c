"""How far vehicles roll: the equations of the check ``strict`` (ours).

All are for SUMO's semi-implicit Euler, in which a step moves a vehicle by the speed that it has
after the step; they are exact for any step length, and broadcast.
"""

import math
from typing import Any

import numpy as np

from drl_av.config import EgoConfig, SimulationConfig, StrictConfig

Number = Any
"""A float, or an array of them."""


def stopping_distance(speed_m_s: Number, braking_m_s2: float, step_s: float) -> Number:
    """How far a vehicle rolls that brakes from now on until it stands, metres.

    Less by v dt / 2 than v^2 / 2b, where v is a whole number of steps' braking.
    """
    steps = np.floor(speed_m_s / (braking_m_s2 * step_s))
    return step_s * steps * (speed_m_s - braking_m_s2 * step_s * (steps + 1) / 2)


def travel(
    speed_m_s: Number,
    acceleration_m_s2: Number,
    steps: int,
    step_s: float,
    max_speed_m_s: float = math.inf,
) -> tuple[Number, Number]:
    """Distance and speed after some steps at an acceleration within [0, max_speed_m_s]."""
    distance_m, speed = 0.0, speed_m_s
    for step in range(1, steps + 1):
        wanted = speed_m_s + acceleration_m_s2 * (step * step_s)
        speed = np.minimum(np.maximum(wanted, 0.0), max_speed_m_s)
        distance_m = distance_m + speed * step_s
    return distance_m, speed


def reach(
    speed_m_s: Number,
    acceleration_m_s2: Number,
    ego: EgoConfig,
    sim: SimulationConfig,
) -> Number:
    """How far the ego rolls in a decision at an acceleration and in braking hard afterwards."""
    step_s = sim.step_length_s
    distance_m, speed = travel(
        speed_m_s, acceleration_m_s2, sim.steps_per_decision, step_s, ego.max_speed_m_s
    )
    return distance_m + stopping_distance(speed, ego.hard_brake_m_s2, step_s)


def cut_in_gap(
    speed_m_s: Number,
    acceleration_m_s2: Number,
    other_m_s: Number,
    strict: StrictConfig,
    ego: EgoConfig,
    sim: SimulationConfig,
) -> Number:
    """The gap to the ego beyond which a vehicle may begin to move in ahead of it, metres.

    The ego stops behind it if it goes on as it does for one decision and brakes hard then.
    """
    ahead_m = stopping_distance(other_m_s, strict.braking_m_s2, sim.step_length_s)
    rolled_m = reach(speed_m_s, acceleration_m_s2, ego, sim)
    return np.maximum(rolled_m - ahead_m, 0.0) + strict.clearance_m
