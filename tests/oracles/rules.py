"""The drivers idm, idm-mobil and gap-mobil on indicators by name, in plain Python."""

import math

import numpy as np
import numpy.typing as npt

from drl_av.config import EgoConfig, MobilConfig, SafetyConfig
from drl_av.drivers.driver import Driver
from drl_av.driving.actions import Action, Lateral, Longitudinal, nearest_action, toward
from drl_av.driving.affordances import Affordances, Neighbor
from drl_av.driving.scene import Scene
from drl_av.road.road import LANE_CHANGE_DUE_M
from drl_av.road.snapshot import EGO
from oracles.affordances import has_lane
from oracles.paper import closing_speed, gap_condition, safe_action, time_to_collision
from oracles.plan import idm_acceleration, time_gap_acceleration


def idm_action(affordances: Affordances, config: SafetyConfig) -> Longitudinal:
    """Choose the longitudinal action of the paper's IDM, with one added condition.

    The action is to accelerate if T_C > T_A and the gap condition (eq. 3) holds, and otherwise
    the safe action (eq. 4). T_C is the time to collision with the vehicle ahead, s, infinite
    without a vehicle; T_A is ``config.accelerate_ttc_s``. The gap condition is ours: at equal
    speeds T_C is infinite at any gap, so without it the ego would accelerate into the vehicle
    ahead.
    ``config.printed_idm`` removes the condition, as in the paper.
    """
    front = affordances.own_front
    if front is None:
        return Longitudinal.ACCELERATE
    closing = closing_speed(front)
    ttc_s = time_to_collision(front.gap_m, closing)
    may_close_in = config.printed_idm or gap_condition(front.gap_m, closing, config)
    if ttc_s > config.accelerate_ttc_s and may_close_in:
        return Longitudinal.ACCELERATE
    return safe_action(ttc_s, config)


class IdmDriver(Driver):
    """The driver ``idm``: follows the paper's IDM, and never changes lanes."""

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Keep the lane, with the longitudinal action of the paper's IDM."""
        return Action(Lateral.KEEP, idm_action(scene.affordances, self._config))


MANDATORY_BIAS_M_S2 = 4.0
"""Largest bias of MOBIL's incentive criterion towards a mandatory lane change (ours)."""


class MobilDriver(Driver):
    """The drivers ``idm-mobil`` and, with a time gap ``headway_s`` above 0, ``gap-mobil``."""

    def __init__(
        self, safety: SafetyConfig, ego: EgoConfig, mobil: MobilConfig, headway_s: float = 0.0
    ) -> None:
        self._safety, self._ego, self._mobil, self._headway_s = safety, ego, mobil, headway_s

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the IDM's longitudinal action, with a lane change if MOBIL demands one.

        The driver starts a change to the lane with the larger gain if MOBIL's safety and incentive
        criteria both hold. It never aborts a lane change.
        """
        longitudinal = self.longitudinal(scene.affordances)
        if scene.lane_change is not None:
            return Action(Lateral.KEEP, longitudinal)
        bias, sides = self.bias(scene.affordances), (1, -1)
        open_sides = [sign for sign in sides if has_lane(scene.affordances, sign)]
        gains = {sign: self.gain(scene, sign) + sign * bias for sign in open_sides}
        sign = max(gains, key=lambda side: gains[side], default=0)
        is_beneficial = sign != 0 and gains[sign] > self._mobil.threshold_m_s2
        return Action(toward(sign) if is_beneficial else Lateral.KEEP, longitudinal)

    def longitudinal(self, affordances: Affordances) -> Longitudinal:
        """Return the action of the paper's IDM, or the one that is nearest to the time-gap law.

        With the law, the action is to accelerate if no vehicle ahead is in range.
        """
        speed, front, headway_s = affordances.ego_speed_m_s, affordances.own_front, self._headway_s
        if not headway_s:
            return idm_action(affordances, self._safety)
        if front is None:
            return Longitudinal.ACCELERATE
        gap = front.gap_m, closing_speed(front)
        return nearest_action(time_gap_acceleration(speed, *gap, headway_s, self._ego), self._ego)

    def bias(self, affordances: Affordances) -> float:
        """Return MOBIL's bias towards mandatory lane changes, m/s^2, left positive (ours).

        The bias grows while the distance that is left for the lane changes shrinks. It is largest
        once this distance is ``LANE_CHANGE_DUE_M`` for each lane change. It is 0 if none is
        mandatory.
        """
        lanes, within_m = affordances.mandatory
        share = abs(lanes) * LANE_CHANGE_DUE_M / max(within_m, 1.0)
        return math.copysign(MANDATORY_BIAS_M_S2 * min(share, 1.0), lanes)

    def gain(self, scene: Scene, sign: int) -> float:
        """Return the gain of a lane change to the left (+1) or right (-1), m/s^2.

        The gain is the left side of MOBIL's incentive criterion, a_c' - a_c + p (a_n' - a_n + a_o'
        - a_o). Here c is the ego, n its follower after the lane change, o its follower before it,
        a' an acceleration after the lane change, a one before it, and p the politeness. The gain is
        -inf if n would brake harder than the safety criterion permits.
        """
        seen, length_m = scene.affordances, float(scene.snapshot.length_m[EGO])
        front, rear = seen.front(sign), seen.rear(sign)
        new_follower = self._behind(seen, rear)
        if new_follower < -self._mobil.safe_braking_m_s2:
            return -math.inf
        own = self._ahead(seen, front) - self._ahead(seen, seen.own_front)
        freed = self._without_ego(seen, seen.own_rear, seen.own_front, length_m)
        others = new_follower - self._without_ego(seen, rear, front, length_m) + freed
        return own + self._mobil.politeness * (others - self._behind(seen, seen.own_rear))

    def _idm(self, speed_m_s: float, gap_m: float, closing_m_s: float) -> float:
        desired = self._ego.max_speed_m_s
        return idm_acceleration(speed_m_s, desired, gap_m, closing_m_s, self._mobil)

    def _ahead(self, affordances: Affordances, front: Neighbor | None) -> float:
        """Return the ego's IDM acceleration behind ``front``, m/s^2; None means a free road."""
        if front is None:
            return self._idm(affordances.ego_speed_m_s, math.inf, 0.0)
        return self._idm(affordances.ego_speed_m_s, front.gap_m, -front.relative_speed_m_s)

    def _behind(self, affordances: Affordances, rear: Neighbor | None) -> float:
        """Return the IDM acceleration of ``rear`` behind the ego, m/s^2; 0 if ``rear`` is None."""
        if rear is None:
            return 0.0
        speed = affordances.ego_speed_m_s + rear.relative_speed_m_s
        return self._idm(speed, rear.gap_m, rear.relative_speed_m_s)

    def _without_ego(
        self, seen: Affordances, rear: Neighbor | None, front: Neighbor | None, length_m: float
    ) -> float:
        """Return the IDM acceleration of ``rear`` behind ``front`` without the ego, m/s^2."""
        if rear is None:
            return 0.0
        speed = seen.ego_speed_m_s + rear.relative_speed_m_s
        if front is None:
            return self._idm(speed, math.inf, 0.0)
        gap_m = rear.gap_m + length_m + front.gap_m
        return self._idm(speed, gap_m, rear.relative_speed_m_s - front.relative_speed_m_s)
