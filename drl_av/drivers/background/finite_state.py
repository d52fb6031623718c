"""Drives background vehicles by a finite-state machine: cruise, follow, change lanes.

The states, and their conditions on gaps and relative speeds, are those of Zhang, Li, Girard and
Kolmanovsky 2017; the control in each state is ours. The functions decide for one vehicle, from the
arrays that ``indicators`` has filled for it.
"""

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.config import Config, FiniteStateConfig
from drl_av.driving.affordances import LANE, gap_in, has_lane, slot_of
from drl_av.random_streams import Stream, generator
from drl_av.road.road import CENTERED_M
from drl_av.simulation.population import DriverModel

CRUISE, FOLLOW, LANE_CHANGE = range(3)
"""The states of a vehicle in the finite-state machine."""


def finite_state(
    values: FloatArray,
    codes: IntArray,
    lane_width_m: float,
    state: int,
    desired_m_s: float,
    config: FiniteStateConfig,
) -> tuple[int, float, int]:
    """Return the next state, the acceleration, m/s^2, and the wanted lane change of a vehicle.

    The lane change is +1 to the left, -1 to the right, 0 for none. A vehicle behind a slow leader
    requests a change to the faster neighbouring lane if the gaps in that lane are large enough. If
    SUMO has not begun that lane change by the next decision, the vehicle returns to FOLLOW or
    CRUISE.
    """
    off_center_m = values[25] - codes[LANE] * lane_width_m
    changing = abs(off_center_m) > CENTERED_M
    state = longitudinal_state(values, codes, state, config)
    side = 0 if changing else wanted_side(values, codes, state, desired_m_s, config)
    if changing or side != 0:
        state = LANE_CHANGE
    leaning = np.sign(off_center_m) if state == LANE_CHANGE else 0.0
    wanted = config.speed_gain_per_s * (desired_m_s - values[24])
    if state != CRUISE:
        wanted = min(wanted, behind(values, codes, 0, config))
    if leaning != 0.0:
        wanted = min(wanted, behind(values, codes, 1 if leaning > 0.0 else -1, config))
    limited = min(max(wanted, -config.braking_m_s2), config.acceleration_m_s2)
    return state, limited, side


def looks_aside(
    values: FloatArray,
    codes: IntArray,
    lane_width_m: float,
    state: int,
    desired_m_s: float,
    config: FiniteStateConfig,
) -> bool:
    """Return whether ``finite_state`` depends on more of the scene than the vehicle ahead."""
    changing = abs(values[25] - codes[LANE] * lane_width_m) > CENTERED_M
    follows = longitudinal_state(values, codes, state, config) == FOLLOW
    return changing or (follows and is_slow(values, desired_m_s, config))


def longitudinal_state(
    values: FloatArray, codes: IntArray, state: int, config: FiniteStateConfig
) -> int:
    """Return FOLLOW near the vehicle ahead, else CRUISE, with a hysteresis."""
    headway_s = config.follow_headway_s if state == CRUISE else config.cruise_headway_s
    near_m = config.standstill_gap_m + headway_s * values[24]
    return FOLLOW if gap_in(values, codes, 0) < near_m else CRUISE


def wanted_side(
    values: FloatArray, codes: IntArray, state: int, desired_m_s: float, config: FiniteStateConfig
) -> int:
    """Return the lane change that a vehicle wants: +1 left, -1 right, 0 none."""
    if state != FOLLOW or not is_slow(values, desired_m_s, config):
        return 0
    left = gain(values, codes, 1, config) if clear(values, codes, 1, config) else -np.inf
    right = gain(values, codes, -1, config) if clear(values, codes, -1, config) else -np.inf
    if not max(left, right) >= config.worthwhile_gain_m_s:
        return 0
    return 1 if left >= right else -1


def is_slow(values: FloatArray, desired_m_s: float, config: FiniteStateConfig) -> bool:
    """Return whether the vehicle ahead is slow."""
    slow: bool = values[24] + values[1] < desired_m_s - config.slow_leader_m_s
    return slow


def clear(values: FloatArray, codes: IntArray, sign: int, config: FiniteStateConfig) -> bool:
    """Return whether a lane exists and its gaps are large enough to enter it."""
    front, found = slot_of(sign), has_lane(codes, sign)
    for slot, direction in ((front, -1.0), (front + 1, 1.0)):
        closing_m_s = values[4 * slot + 1] * direction
        needed_m = config.lane_change_gap_m + config.lane_change_time_s * max(closing_m_s, 0.0)
        found = found and gap_in(values, codes, slot) > needed_m
    return found


def gain(values: FloatArray, codes: IntArray, sign: int, config: FiniteStateConfig) -> float:
    """Return the gain in speed of a change to a lane, m/s; inf if the lane is free."""
    far_m, front = config.standstill_gap_m + config.cruise_headway_s * values[24], slot_of(sign)
    faster_m_s: float = values[4 * front + 1] - values[1]
    return np.inf if gap_in(values, codes, front) > far_m else faster_m_s


def behind(values: FloatArray, codes: IntArray, sign: int, config: FiniteStateConfig) -> float:
    """Return the acceleration that keeps the headway in a lane, m/s^2; inf if it is free."""
    front = slot_of(sign)
    kept_m = config.standstill_gap_m + config.headway_s * values[24]
    to_spare_m = gap_in(values, codes, front) - kept_m
    closing_m_s = -values[4 * front + 1]
    wanted: float = config.gap_gain_per_s2 * to_spare_m - config.speed_gain_per_s * closing_m_s
    return wanted


class HardBraking:
    """Draws at each decision which vehicles begin to brake hard.

    They brake for ``traffic.hard_brake_s`` decisions, and nothing begins anew before the end.
    ``driver_models`` holds the ``DriverModel`` of each row; it may hold none that brakes hard.
    """

    def __init__(self, seed: int, driver_models: IntArray, config: Config) -> None:
        self._rng = generator(seed, Stream.HARD_BRAKING)
        self._rows = np.flatnonzero(driver_models == DriverModel.HARD_BRAKING)
        traffic = config.traffic
        self._chance = traffic.hard_brakes_per_s * config.simulation.decision_interval_s
        self._duration = traffic.hard_brake_s

    def begun(self, decisions: int) -> IntArray:
        """Draw so many decisions; return who is to begin: decision and row, shape (found, 2)."""
        draws = self._rng.random((decisions, len(self._rows))) < self._chance
        decision, place = np.nonzero(draws)
        return np.stack((decision, self._rows[place]), axis=1)

    def __call__(self, left: IntArray) -> None:
        """Let the vehicles of the next decision begin; ``left`` has each row's decisions left."""
        for _, row in self.begun(1).tolist() if len(self._rows) else ():
            left[row] = left[row] or self._duration
