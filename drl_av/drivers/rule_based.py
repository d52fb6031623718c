"""Rule-based drivers: those of Sec. IV-C of the paper, MOBIL, a gap rule, and SUMO itself."""

import math

import numpy as np

from drl_av.arrays import Float32Array, FloatArray, IntArray
from drl_av.compiled import compiled
from drl_av.config import EgoConfig, MobilConfig, SafetyConfig, SimulationConfig
from drl_av.drivers.driver import Driver
from drl_av.driving.actions import (
    ACCELERATE,
    ACTIONS,
    LEFT,
    RIGHT,
    Action,
    EgoNumbers,
    acceleration_of,
    ego_numbers,
    toward,
)
from drl_av.driving.affordances import (
    ALLOWED,
    CHANGES,
    NO_VEHICLE,
    WITHIN,
    gap_in,
    has_lane,
    slot_of,
)
from drl_av.driving.car_following import idm_acceleration, time_gap_acceleration
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.random_streams import Stream, generator
from drl_av.road.road import LANE_CHANGE_DUE_M
from drl_av.road.snapshot import EGO
from drl_av.safety.paper import gap_condition, safe_action, time_to_collision
from drl_av.simulation.vehicle_calls import EgoModel


class IdmDriver(Driver):
    """The driver ``idm``: follows the paper's IDM, and never changes lanes."""

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Keep the lane, with the longitudinal action of the paper's IDM."""
        values, codes, *_ = scene.indicators
        return ACTIONS[idm_number(values, codes, self._config)]


class IdmSumoDriver(IdmDriver):
    """The driver ``idm-sumo``: ``idm``, plus the lane changes that SUMO's SL2015 would make."""

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return the IDM's longitudinal action, with the lane change that SUMO's model demands.

        A lane change in progress is always completed.

        Raises:
            ConfigError: no SUMO is asked in this scene, as in the twin.
        """
        wanted = scene.snapshot.sumo_lane_change
        if wanted is None:
            raise ConfigError(
                "idm-sumo changes lanes as SUMO asks the ego to, which only the environment in "
                "SUMO reads: take idm-mobil."
            )
        sign = wanted if scene.lane_change is None else 0
        return super().act(scene, observation)._replace(lateral=toward(sign))


class RandomDriver:
    """The driver ``random``: chooses each of the 12 actions with equal probability."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng()

    def start(self, seed: int) -> None:
        """Create the random generator of the episode from ``seed``."""
        self._rng = generator(seed, Stream.RANDOM_DRIVER)

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Draw one of the 12 actions."""
        return ACTIONS[self._rng.integers(len(ACTIONS))]


class MobilDriver(Driver):
    """The drivers ``idm-mobil`` and ``gap-mobil``: change lanes by MOBIL, and abort no lane change.

    In its lane the driver follows the paper's IDM, or keeps a constant time gap of ``headway_s`` to
    the vehicle ahead, if that is above 0. No parameter is tuned to any traffic: the standstill gap
    and the gain of the time-gap law are those of the adaptive cruise control
    (``ego.longitudinal_reference`` = ``acc``).
    """

    def __init__(
        self, safety: SafetyConfig, ego: EgoConfig, mobil: MobilConfig, headway_s: float = 0.0
    ) -> None:
        self._headway_s = headway_s
        self._numbers = safety.numbers, ego_numbers(ego, SimulationConfig()), mobil.numbers

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return the longitudinal action, with a lane change if MOBIL demands one."""
        values, codes, *_ = scene.indicators
        now = scene.lane_change is not None, float(scene.snapshot.length_m[EGO]), self._headway_s
        number: int = rule_action.fast(values, codes, *now, *self._numbers)
        return ACTIONS[number]


TUNED = EgoModel(headway_s=0.8, assertiveness=1.5, speed_gain=5.0, overtake_right=True)
"""The parameters of ``sumo-tuned`` (ours): those with the highest speed in a search. The search is
not part of this project."""


class SumoDriver(Driver):
    """Lets SUMO's IDM and lane-change model SL2015 drive the ego, with the parameters ``model``.

    For this driver ``rollout`` calls ``HighwayEnv.hand_over`` instead of ``act``; the environment
    then ignores actions.
    """

    def __init__(self, model: EgoModel) -> None:
        self.model = model

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Raise ConfigError: SUMO chooses no action."""
        raise ConfigError(
            "SUMO itself drives the ego with this driver, which therefore has no actions: give "
            "its name to drl_av.evaluate, or call env.unwrapped.hand_over(driver.model) after each "
            "reset and pass any action to step."
        )


MANDATORY_BIAS_M_S2 = 4.0
"""Largest bias of MOBIL's incentive criterion towards a mandatory lane change (ours)."""


@compiled
def rule_action(
    values: FloatArray,
    codes: IntArray,
    is_changing: bool,
    length_m: float,
    headway_s: float,
    safety: SafetyConfig,
    ego: EgoNumbers,
    mobil: MobilConfig,
) -> int:
    """Return the number of the action of ``gap-mobil``, or of ``idm-mobil`` if the headway is 0.

    ``is_changing`` says whether the ego is changing lanes; it then keeps to it. ``length_m`` is the
    length of the ego, and ``headway_s`` the time gap that ``gap-mobil`` keeps.
    """
    longitudinal = (
        gap_number(values, codes, headway_s, ego)
        if headway_s > 0.0
        else idm_number(values, codes, safety)
    )
    if is_changing:
        return longitudinal
    side = mobil_side(values, codes, length_m, ego.max_speed_m_s, mobil)
    return longitudinal + 4 * (LEFT if side > 0 else RIGHT if side < 0 else 0)


def idm_number(values: FloatArray, codes: IntArray, config: SafetyConfig) -> int:
    """Return the number of the action of the paper's IDM, with one added condition.

    The action is to accelerate if T_C > T_A and the gap condition (eq. 3) holds, and otherwise
    the safe action (eq. 4). T_C is the time to collision with the vehicle ahead, s, infinite
    without a vehicle; T_A is ``config.accelerate_ttc_s``. The gap condition is ours: at equal
    speeds T_C is infinite at any gap, so without it the ego would accelerate into the vehicle
    ahead. ``config.printed_idm`` removes the condition, as in the paper.
    """
    if codes[0] == NO_VEHICLE:
        return ACCELERATE
    gap_m, closing_m_s = values[0], -values[1]
    ttc_s = time_to_collision(gap_m, closing_m_s)
    may_close_in = config.printed_idm or gap_condition(gap_m, closing_m_s, config)
    if ttc_s > config.accelerate_ttc_s and may_close_in:
        return ACCELERATE
    return safe_action(ttc_s, config)


def gap_number(values: FloatArray, codes: IntArray, headway_s: float, ego: EgoConfig) -> int:
    """Return the number of the action whose acceleration is nearest to that of the time-gap law.

    If no vehicle ahead is in range, the action is to accelerate.
    """
    if codes[0] == NO_VEHICLE:
        return ACCELERATE
    wanted = time_gap_acceleration(values[24], values[0], -values[1], headway_s, ego)
    nearest, least = 0, np.inf
    for number in range(4):
        off = abs(acceleration_of(number, ego) - wanted)
        if off < least:
            nearest, least = number, off
    return nearest


def mobil_side(
    values: FloatArray, codes: IntArray, length_m: float, max_speed_m_s: float, mobil: MobilConfig
) -> int:
    """Return the lane change that MOBIL demands: +1 left, -1 right, 0 none.

    It is the change to the lane with the larger gain, if MOBIL's safety and incentive criteria both
    hold.
    """
    best, side = -np.inf, 0
    for sign in (1, -1):
        if has_lane(codes, sign):
            bias = sign * mandatory_bias(codes[CHANGES], values[WITHIN])
            gain = mobil_gain(values, codes, sign, length_m, max_speed_m_s, mobil) + bias
            if gain > best:
                best, side = gain, sign
    return side if best > mobil.threshold_m_s2 else 0


def mandatory_bias(lanes: int, within_m: float) -> float:
    """Return MOBIL's bias towards mandatory lane changes, m/s^2, left positive (ours).

    The arguments are the fields of ``MandatoryChange``. The bias grows while the distance that is
    left for the lane changes shrinks. It is largest once this distance is ``LANE_CHANGE_DUE_M`` for
    each lane change. It is 0 if none is mandatory.
    """
    share = abs(lanes) * LANE_CHANGE_DUE_M / max(within_m, 1.0)
    return math.copysign(MANDATORY_BIAS_M_S2 * min(share, 1.0), lanes)


def mobil_gain(
    values: FloatArray,
    codes: IntArray,
    sign: int,
    length_m: float,
    max_speed_m_s: float,
    mobil: MobilConfig,
) -> float:
    """Return the gain of a lane change to the left (+1) or right (-1), m/s^2.

    The gain is the left side of MOBIL's incentive criterion (Kesting, Treiber and Helbing 2007),
    a_c' - a_c + p (a_n' - a_n + a_o' - a_o). Here c is the ego, n its follower after the lane
    change, o its follower before it, a' an acceleration after the lane change, a one before it, and
    p the politeness. The gain is -inf if n would brake harder than the safety criterion permits.
    """
    front, desired = slot_of(sign), min(max_speed_m_s, values[ALLOWED])
    new_follower = follower(values, codes, front, True, length_m, desired, mobil)
    if new_follower < -mobil.safe_braking_m_s2:
        return -np.inf
    own = behind_leader(values, codes, front, desired, mobil) - behind_leader(
        values, codes, 0, desired, mobil
    )
    others = (
        new_follower
        - follower(values, codes, front, False, length_m, desired, mobil)
        + follower(values, codes, 0, False, length_m, desired, mobil)
        - follower(values, codes, 0, True, length_m, desired, mobil)
    )
    return own + mobil.politeness * others


def behind_leader(
    values: FloatArray, codes: IntArray, front: int, desired_m_s: float, mobil: MobilConfig
) -> float:
    """Return the ego's IDM acceleration behind the vehicle in the slot ``front``, m/s^2."""
    gap_m, closing_m_s = gap_in(values, codes, front), -values[4 * front + 1]
    return idm_acceleration(values[24], desired_m_s, gap_m, closing_m_s, mobil)


def follower(
    values: FloatArray,
    codes: IntArray,
    front: int,
    has_ego: bool,
    length_m: float,
    desired_m_s: float,
    mobil: MobilConfig,
) -> float:
    """Return the IDM acceleration of the vehicle behind the ego in a lane, m/s^2.

    It follows the ego if the lane ``has_ego``, else the vehicle ahead of the ego in this lane,
    whose slot is ``front``. ``length_m`` is the length of the ego. The result is 0 without a
    vehicle behind.
    """
    rear = front + 1
    if codes[rear] == NO_VEHICLE:
        return 0.0
    gap_m, closing_m_s = values[4 * rear], values[4 * rear + 1]
    speed_m_s = values[24] + closing_m_s
    if not has_ego:
        gap_m = gap_m + length_m + gap_in(values, codes, front)
        closing_m_s -= values[4 * front + 1]
    return idm_acceleration(speed_m_s, desired_m_s, gap_m, closing_m_s, mobil)
