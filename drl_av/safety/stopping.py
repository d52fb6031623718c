"""Stopping distances, with which the check ``strict`` compares actions (ours).

The equations are exact for SUMO's semi-implicit Euler integration, in which a step moves a vehicle
by the speed that it has after the step. They hold for any step length and broadcast over arrays.
"""

import math
from typing import Any

import numpy as np

from drl_av.config import EgoConfig, SimulationConfig, StrictConfig
from drl_av.driving.actions import EgoNumbers

Number = Any
"""A float, or an array of floats."""


def stopping_distance(speed_m_s: Number, braking_m_s2: float, step_s: float) -> Number:
    """Return the distance that a vehicle covers while it brakes to a standstill, metres.

    With the braking b and SUMO steps of length dt, it is v^2 / 2b - v dt / 2 if the speed v is a
    multiple of b dt.
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
    """Return the distance, metres, and the speed, m/s, of a vehicle after ``steps`` SUMO steps.

    The acceleration is constant, but the speed stays within [0, max_speed_m_s].
    """
    distance_m, speed = 0.0, speed_m_s
    for step in range(1, steps + 1):
        wanted = speed_m_s + acceleration_m_s2 * (step * step_s)
        speed = np.minimum(np.maximum(wanted, 0.0), max_speed_m_s)
        distance_m = distance_m + speed * step_s
    return distance_m, speed


def reach(
    speed_m_s: Number,
    acceleration_m_s2: Number,
    ego: EgoConfig | EgoNumbers,
    sim: SimulationConfig | EgoNumbers,
) -> Number:
    """Return the distance that an ego covers in one decision and the hard braking after it, metres.

    ``acceleration_m_s2`` acts during the decision; the ego then brakes hard until standstill.
    """
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
    """Return the gap, metres, above which another vehicle may begin to cut in ahead of the ego.

    With a larger gap the ego stops behind the vehicle: it drives with ``acceleration_m_s2`` for one
    decision, and then brakes hard. ``speed_m_s`` is the ego's speed, ``other_m_s`` that of the
    vehicle. If IDM or ACC controls the ego's speed, ``ego.accelerate_m_s2`` is used instead of
    ``acceleration_m_s2``, because they may accelerate so much at any time.
    """
    if ego.longitudinal_reference != "acceleration":
        acceleration_m_s2 = ego.accelerate_m_s2
    ahead_m = stopping_distance(other_m_s, strict.braking_m_s2, sim.step_length_s)
    rolled_m = reach(speed_m_s, acceleration_m_s2, ego, sim)
    return np.maximum(rolled_m - ahead_m, 0.0) + strict.clearance_m
