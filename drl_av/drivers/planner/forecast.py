"""Forecasts all vehicles for P plans of the ego at once, and scores the plans (ours).

A forecast advances in steps of one second. The ego follows its plan within the limits of the safety
check. The other vehicles follow IDM with the parameters that the planner has estimated. They
complete the lane changes in progress, and begin none.
"""

from typing import NamedTuple

import numpy as np

from drl_av.config import EgoConfig
from drl_av.drivers.planner.low_level_controller import (
    LONG_HEADWAY_S,
    Control,
    Ego,
    LowLevelController,
    OthersAround,
)
from drl_av.drivers.planner.others import FAR_M, BoolArray, IntArray, Lanes, Others, idm
from drl_av.drivers.planner.parameter_estimator import ParameterEstimator
from drl_av.road.road import LANE_CHANGE_DUE_M, FloatArray, MandatoryChange

SETTLED_S = 2
"""Seconds after which a vehicle that is changing lanes now has left its old lane."""
LATE = 0.75
"""A vehicle moves (1 - LATE) * v_0 + LATE * v_1 in a second, at speed v_0 before and v_1 after it.

This is exact for a constant acceleration in two SUMO steps of half a second.
"""
HARDEST_M_S2 = 4.0
"""Largest deceleration of the other vehicles."""


class PlanCosts(NamedTuple):
    """The parameters of a plan's score: the distance that the ego drives, minus a price per event.

    A price is in metres: an event of price 4 is as bad as driving 4 m less.
    """

    hit: float = 1000.0
    """Price per second in which the ego overlaps another vehicle."""
    short_headway: float = 1.5
    """Price per second for each second by which the headway is below 1 s."""
    forced_braking: float = 2.0
    """Price per second and m/s^2 of forced braking: the deceleration of a vehicle behind the ego
    minus 2 m/s^2."""
    lane_change: float = 4.0
    aborted_lane_change: float = 12.0
    reversal: float = 4.0
    """Price of accelerating after braking, or of braking after accelerating."""
    change_of_plan: float = 10.0
    """Amount by which a new plan must score higher than the rest of the current plan."""
    tail_s: float = 10.0
    """Time after the forecast for which the ego is assumed to follow the vehicle ahead."""
    room: float = 0.8
    """Value of each metre at the end of the forecast by which the gap ahead exceeds the time gap
    ``LONG_HEADWAY_S``."""
    late_change: float = 15.0
    """Price per second of each mandatory lane change that is still due when no distance is left.
    With more distance left the price is lower; it is 0 with ``LANE_CHANGE_DUE_M`` left for each."""
    missed_change: float = 400.0
    """As ``late_change``, but charged once, at the end of the forecast."""


class Forecaster:
    """Forecasts the traffic from one scene for many plans of the ego, and scores the plans.

    A plan is the ego's intent for each second. ``lap_m`` is the length of the loop, metres, or
    ``FAR_M`` on an open road.
    """

    def __init__(
        self,
        others: Others,
        watcher: ParameterEstimator,
        lap_m: float,
        chooser: LowLevelController,
        ego: EgoConfig,
        mandatory: MandatoryChange,
    ) -> None:
        self._others, self._lap_m, self._chooser, self._ego = others, lap_m, chooser, ego
        self._desired_m_s, self._headway_s = watcher.desired_m_s, watcher.headway_s
        self._mandatory = mandatory

    def around(self, ego: Ego, x_m: FloatArray, speed: FloatArray) -> OthersAround:
        """Return the other vehicles relative to the egos of the P plans.

        ``x_m`` and ``speed``, shape (P, N), are the vehicles' positions, m, and speeds, m/s.
        """
        ahead_m = x_m - ego.x_m[:, None]
        ahead_m -= self._lap_m * np.round(ahead_m / self._lap_m)
        return OthersAround(ahead_m, speed, self._others.half_m)

    def choice(self, ego: Ego, intent: IntArray) -> Control:
        """Choose the ego's action in the first scene for an intent."""
        around = self.around(ego, self._others.x_m[None], self._others.speed_m_s[None])
        return self._chooser(ego, intent, around, self._others.now.member)

    def scores(self, ego: Ego, sign: int, plans: IntArray, prices: PlanCosts) -> FloatArray:
        """Return the score of each plan, shape (P,): the ego's distance minus the prices, m.

        The forecast advances ``ego`` in place. ``sign`` is +1 if the ego's last change of speed was
        an acceleration, -1 if it was braking, and 0 if there was none.
        """
        shape = len(plans), len(self._others.x_m)
        x_m, speed = (
            np.broadcast_to(values, shape).copy()
            for values in (self._others.x_m, self._others.speed_m_s)
        )
        score, last = np.zeros(len(plans)), np.full(len(plans), sign)
        goal = self._chooser.lane(ego) + self._mandatory.lanes
        for second in range(plans.shape[1]):
            lanes = self._others.now if second < SETTLED_S else self._others.later
            around = self.around(ego, x_m, speed)
            choice = self._chooser(ego, plans[:, second], around, lanes.member)
            signs = np.sign(choice.acceleration_m_s2).astype(np.intp)
            score -= prices.reversal * (signs == -last) * (signs != 0)
            last = np.where(signs != 0, signs, last)
            score -= _price_of_choice(ego, choice, prices)
            self._change_lanes(ego, choice)
            score -= prices.late_change * self._missing_changes(ego, goal)
            faster, price = self._follow(ego, around, x_m, lanes, prices)
            score += self._drive(ego, choice.acceleration_m_s2) - price
            x_m += (1 - LATE) * speed + LATE * faster
            speed = faster
        score -= prices.missed_change * self._missing_changes(ego, goal)
        return score + self._tail(ego, self.around(ego, x_m, speed), prices)

    def _missing_changes(self, ego: Ego, goal: IntArray) -> FloatArray:
        """Return how many mandatory lane changes are urgent, shape (P,).

        The number is a fraction: the lane changes that are left, minus one for each
        ``LANE_CHANGE_DUE_M`` of the distance that is left for them.
        """
        changes = np.maximum(self._mandatory.side * (goal - self._chooser.lane(ego)), 0)
        left_m = np.maximum(self._mandatory.within_m - ego.x_m, 0.0)
        missing: FloatArray = np.maximum(changes - left_m / LANE_CHANGE_DUE_M, 0.0)
        return missing

    def _change_lanes(self, ego: Ego, choice: Control) -> None:
        """Advance the egos' lane changes by a second, in place."""
        aborts, begins = choice.aborts, choice.begins
        seconds = round(self._ego.lane_change_duration_s)
        back = np.where(aborts, seconds - ego.seconds, ego.seconds)
        ego.origin, ego.target = (
            np.where(aborts, ego.target, ego.origin),
            np.where(aborts, ego.origin, ego.target + begins),
        )
        ego.seconds = np.where(ego.origin != ego.target, back + 1, 0)
        arrives = ego.seconds >= seconds
        ego.origin = np.where(arrives, ego.target, ego.origin)
        ego.seconds = np.where(arrives, 0, ego.seconds)

    def _drive(self, ego: Ego, acceleration: FloatArray) -> FloatArray:
        """Move the egos along the road for a second, in place; return the distances, shape (P,)."""
        speed = np.clip(ego.speed_m_s + acceleration, 0.0, self._ego.max_speed_m_s)
        moved_m: FloatArray = (1 - LATE) * ego.speed_m_s + LATE * speed
        ego.x_m, ego.speed_m_s = ego.x_m + moved_m, speed
        return moved_m

    def _follow(
        self, ego: Ego, around: OthersAround, x_m: FloatArray, lanes: Lanes, prices: PlanCosts
    ) -> tuple[FloatArray, FloatArray]:
        """Return the other vehicles' speeds a second later, (P, N), and a price, shape (P,).

        The price is for collisions with the ego, and for braking that the ego forces on others.
        """
        gap_m, lead = x_m[:, lanes.leader] - x_m + lanes.offset_m, around.speed_m_s[:, lanes.leader]
        shares = self._shares_lane(ego, lanes.member)
        to_ego_m = -around.ahead_m - around.half_m
        to_ego_m += self._lap_m * (around.ahead_m >= 0)
        follows = shares & (to_ego_m < gap_m)
        gap_m = np.where(follows, to_ego_m, gap_m)
        lead = np.where(follows, ego.speed_m_s[:, None], lead)
        speed = around.speed_m_s
        rate = idm(speed, self._desired_m_s, self._headway_s, gap_m, speed - lead)
        hits = (shares & (np.abs(around.ahead_m) < around.half_m)).any(axis=1)
        forced = np.where(follows, np.clip(-2.0 - rate, 0.0, HARDEST_M_S2), 0.0).sum(axis=1)
        price: FloatArray = prices.hit * hits + prices.forced_braking * forced
        return np.maximum(speed + np.maximum(rate, -HARDEST_M_S2), 0.0), price

    def _shares_lane(self, ego: Ego, member: BoolArray) -> BoolArray:
        """Return whether each vehicle uses a lane that the ego's body overlaps, shape (P, N)."""
        from_line = ego.seconds - self._ego.lane_change_duration_s / 2
        in_origin, in_target = from_line < 1.0, from_line > -1.0
        result: BoolArray = (member[ego.origin] & in_origin[:, None]) | (
            member[ego.target] & in_target[:, None]
        )
        return result

    def _tail(self, ego: Ego, around: OthersAround, prices: PlanCosts) -> FloatArray:
        """Return the value of the scene at the end of a forecast, m, shape (P,).

        It is the distance that the ego can drive behind the vehicle ahead in ``prices.tail_s``.
        """
        front, _ = around.near(self._others.later.member[self._chooser.lane(ego)])
        room_m = np.maximum(front.gap_m - LONG_HEADWAY_S * ego.speed_m_s, 0.0)
        worth_m = prices.tail_s * front.speed_m_s + prices.room * room_m
        most_m = prices.tail_s * self._ego.max_speed_m_s
        return np.where(front.gap_m < FAR_M / 2, np.minimum(worth_m, most_m), most_m)


def _price_of_choice(ego: Ego, choice: Control, prices: PlanCosts) -> FloatArray:
    missing_s = np.maximum(1.0 - choice.front.gap_m / np.maximum(ego.speed_m_s, 1.0), 0.0)
    price: FloatArray = prices.short_headway * missing_s
    price = price + prices.lane_change * (choice.begins != 0)
    return price + prices.aborted_lane_change * choice.aborts
