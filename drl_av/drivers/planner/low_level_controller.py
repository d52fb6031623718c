"""Chooses the ego's action for the intent of its plan, in P scenes at once (ours).

Arrays have shape (P,) for the ego and (P, N) for the N other vehicles, unless stated otherwise.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drl_av.config import EgoConfig
from drl_av.config.traffic import CONGESTED_M_S
from drl_av.drivers.planner.limits import Limits, NextVehicle
from drl_av.drivers.planner.others import FAR_M, BoolArray, IntArray
from drl_av.drivers.planner.plans import SIDE, YIELDS
from drl_av.driving.car_following import time_gap_acceleration
from drl_av.road.road import FloatArray

SHORT_HEADWAY_S = 1.0
"""The ego brakes if the time-gap law with this headway demands braking."""
LONG_HEADWAY_S = 1.4
"""The ego accelerates if the time-gap law with this headway demands acceleration. If the ego need
neither brake nor accelerate, it maintains its speed."""
STEADY_S = 10.0
"""The ego accelerates only if it need not brake in the ``STEADY_S`` seconds after that, while the
vehicle ahead keeps its speed. This does not apply while a lane change is mandatory."""
BRAKES_FROM = 0.7
"""The ego takes a braking action if it needs more than this share of the action's deceleration to
slow down to the speed of the vehicle ahead before the gap is closed."""
SLOWEST_YIELDING_M_S = 8.0
"""Speed below which the ego does not brake in order to change behind a vehicle."""
MARGIN_M = 2.0
"""Additional gap that the ego requires to begin a lane change, so that it need not abort it."""


@dataclass
class Ego:
    """The ego in P scenes; ``origin`` and ``target`` are its lanes, equal without a lane change."""

    x_m: FloatArray
    """Distance driven since the start of the forecast."""
    speed_m_s: FloatArray
    origin: IntArray
    target: IntArray
    seconds: IntArray
    """Seconds that a lane change needs from ``origin`` to the present position; 0 without one."""


class Control(NamedTuple):
    """The action of the ego for one second."""

    acceleration_m_s2: FloatArray
    begins: IntArray
    """Direction of the lane change that begins: left +1, right -1, none 0."""
    aborts: BoolArray
    """Whether the ego aborts its lane change."""
    front: NextVehicle
    """The vehicle ahead in the ego's lane."""


class OthersAround(NamedTuple):
    """The other vehicles as the ego sees them in each scene."""

    ahead_m: FloatArray
    """Distance between the centres, the shorter way around a loop; positive ahead of the ego."""
    speed_m_s: FloatArray
    half_m: FloatArray
    """Distance between the centres at which a vehicle touches the ego, shape (N,)."""

    def near(self, member: BoolArray) -> tuple[NextVehicle, NextVehicle]:
        """Return the next vehicle ahead and the next vehicle behind.

        ``member``, shape (P, N), selects the vehicles that count.
        """
        return self._nearest(member & (self.ahead_m >= 0)), self._nearest(
            member & (self.ahead_m < 0)
        )

    def _nearest(self, candidates: BoolArray) -> NextVehicle:
        if candidates.shape[1] == 0:
            return NextVehicle(np.full(len(candidates), FAR_M), np.zeros(len(candidates)))
        distance_m = np.where(candidates, np.abs(self.ahead_m), FAR_M)
        nearest = distance_m.argmin(axis=1)
        rows = np.arange(len(nearest))
        gap_m = np.maximum(distance_m[rows, nearest] - self.half_m[nearest], 0.0)
        return NextVehicle(gap_m, self.speed_m_s[rows, nearest])


class LowLevelController:
    """Chooses the ego's actions within the limits of the safety check.

    ``open_lanes``, shape (L,), says which lanes are open. ``due_side`` is that of a mandatory
    lane change: left +1, right -1, or 0 if none is mandatory.
    """

    def __init__(
        self, open_lanes: BoolArray, ego: EgoConfig, limits: Limits, due_side: int = 0
    ) -> None:
        self._open, self._ego, self._limits, self._due_side = open_lanes, ego, limits, due_side
        self._crossing_s = ego.lane_change_duration_s / 2
        rates = [ego.accelerate_m_s2, 0.0, -ego.brake_m_s2, -ego.hard_brake_m_s2]
        self._rates = np.array(rates)[:, None]

    def lane(self, ego: Ego) -> IntArray:
        """Return the lane that contains the ego's centre."""
        return np.where(ego.seconds > self._crossing_s, ego.target, ego.origin)

    def __call__(
        self, ego: Ego, intent: IntArray, around: OthersAround, member: BoolArray
    ) -> Control:
        """Choose the action of the ego in each scene; ``intent`` has shape (P,).

        ``member``, shape (L, N), says which lanes each other vehicle uses.
        """
        direction, lane, wanted = ego.target - ego.origin, self.lane(ego), SIDE[intent]
        changes, crossed = direction != 0, ego.seconds > self._crossing_s
        other = np.where(changes, np.where(crossed, ego.origin, ego.target), lane + wanted)
        exists = (other >= 0) & (other < len(self._open))
        other = np.clip(other, 0, len(self._open) - 1)
        exists &= self._open[other]
        own, own_rear = around.near(member[lane])
        front, rear = around.near(member[other])
        into, from_behind = own.where(crossed, front), own_rear.where(crossed, rear)
        if self._limits.followers_stay_behind:
            from_behind = NextVehicle(np.where(crossed, FAR_M, rear.gap_m), rear.speed_m_s)
        margin_m = np.where(changes | (wanted == self._due_side), 0.0, MARGIN_M)
        while_maintaining = self._permits(ego.speed_m_s, (own, into), from_behind, margin_m)
        while_braking, brake = while_maintaining, -self._ego.brake_m_s2
        if self._due_side:
            while_braking = self._permits(ego.speed_m_s, (own, into), from_behind, margin_m, brake)
        permitted = while_maintaining | while_braking
        if not self._ego.overtake_right:
            exists &= (wanted >= 0) | ~_is_passed_on_the_left(own)
        begins = np.where(~changes & exists & permitted, wanted, 0)
        fails = changes & ~permitted
        if crossed.any():
            fails &= ~crossed | self._permits(ego.speed_m_s, (own, front), rear, 0.0)
        follows_both = changes & ~crossed | (begins != 0)
        leaves = follows_both & (np.where(changes, direction, begins) == self._due_side)
        rate = self._follow(ego.speed_m_s, front.where(leaves, own), front.where(follows_both, own))
        goes_on = self._to_continue(ego.speed_m_s, own, front)
        rate = np.where(follows_both, np.minimum(rate, goes_on), rate)
        must_brake = follows_both & while_braking & ~while_maintaining
        must_not_brake = follows_both & while_maintaining & ~while_braking
        rate = np.where(must_brake, np.minimum(rate, brake), rate)
        rate = np.where(must_not_brake, np.maximum(rate, 0.0), rate)
        yields = YIELDS[intent] & ~changes & (begins == 0)
        yields &= ego.speed_m_s > SLOWEST_YIELDING_M_S
        rate = np.where(yields, np.minimum(rate, -self._ego.brake_m_s2), rate)
        if not self._ego.overtake_right:
            rate = np.minimum(rate, self._behind_the_left(ego, lane, around, member))
        rate = np.minimum(rate, self._limits.fastest(ego.speed_m_s, own))
        return Control(rate, begins, fails | (changes & (wanted == -direction)), own)

    def _permits(
        self,
        speed: FloatArray,
        fronts: tuple[NextVehicle, NextVehicle],
        rear: NextVehicle,
        margin_m: FloatArray | float,
        rate: float = 0.0,
    ) -> BoolArray:
        """Return whether the check permits a lane change behind ``fronts``, ahead of ``rear``.

        ``rate`` is the ego's acceleration in the next second, m/s^2, not above 0.
        """
        first, second = (self._limits.clear_ahead(speed, front, margin_m, rate) for front in fronts)
        return first & second & self._limits.clear_behind(speed, rear, margin_m, rate)

    def _to_continue(self, speed: FloatArray, own: NextVehicle, front: NextVehicle) -> FloatArray:
        """Return the largest acceleration that still permits the lane change a second later, m/s^2.

        Both vehicles ahead are assumed to keep their speeds. The result is hard braking if no
        acceleration of an action is small enough.
        """
        faster = np.clip(speed + self._rates, 0.0, self._ego.max_speed_m_s)
        permitted = np.ones(faster.shape, dtype=np.bool_)
        for near in (own, front):
            gap_m = near.gap_m - (speed + faster) / 2 + near.speed_m_s
            permitted &= self._limits.clear_ahead(faster, NextVehicle(gap_m, near.speed_m_s))
        permitted[-1] = True
        most: FloatArray = self._rates[permitted.argmax(axis=0), 0]
        return most

    def _behind_the_left(
        self, ego: Ego, lane: IntArray, around: OthersAround, member: BoolArray
    ) -> FloatArray:
        """Return an acceleration, m/s^2, with which the ego does not pass on the right.

        The ego follows the vehicle ahead in the left lane, unless it may pass this vehicle.
        """
        left = np.minimum(lane + 1, len(self._open) - 1)
        front, _ = around.near(member[left])
        binds = (left > lane) & _is_passed_on_the_left(front)
        rate = self._follow(ego.speed_m_s, front, front)
        return np.where(binds, rate, self._ego.accelerate_m_s2)

    def _follow(self, speed: FloatArray, own: NextVehicle, front: NextVehicle) -> FloatArray:
        """Return the acceleration with which the ego follows two vehicles, m/s^2.

        It is that of an action, or that of the model ``ego.longitudinal_reference``.
        """
        ego = self._ego
        braking = np.minimum(self._braking(speed, own), self._braking(speed, front))
        if ego.longitudinal_reference != "acceleration":
            free = ego.acc_speed_gain_per_s * (ego.max_speed_m_s - speed)
            wanted = np.minimum(free, self._law(speed, own, ego.reference_headway_s))
            wanted = np.clip(wanted, -ego.hard_brake_m_s2, ego.accelerate_m_s2)
            return np.where(braking < 0, np.minimum(braking, wanted), wanted)
        may = np.minimum(
            self._law(speed, own, LONG_HEADWAY_S), self._law(speed, front, LONG_HEADWAY_S)
        )
        accelerates = (braking == 0) & (may > ego.accelerate_m_s2 / 2)
        if not self._due_side:
            accelerates &= self._stays_steady(speed, own) & self._stays_steady(speed, front)
        return np.where(accelerates, ego.accelerate_m_s2, braking)

    def _stays_steady(self, speed: FloatArray, front: NextVehicle) -> BoolArray:
        """Return whether the ego can accelerate now without braking in the ``STEADY_S`` after it.

        The vehicle ahead is assumed to keep its speed.
        """
        faster = np.minimum(speed + self._ego.accelerate_m_s2, self._ego.max_speed_m_s)
        gap_m = front.gap_m - (speed + faster) / 2 + front.speed_m_s
        gap_m -= STEADY_S * np.maximum(faster - front.speed_m_s, 0.0)
        later = NextVehicle(np.maximum(gap_m, 0.0), front.speed_m_s)
        steady: BoolArray = (self._limits.fastest(faster, later) >= 0) & (
            self._braking(faster, later) == 0
        )
        return steady

    def _braking(self, speed: FloatArray, front: NextVehicle) -> FloatArray:
        """Return the acceleration, m/s^2, of the mildest action that is safe behind ``front``.

        The actions are maintain (0), brake and hard brake.
        """
        ego, closing = self._ego, np.maximum(speed - front.speed_m_s, 0.0)
        law = self._law(speed, front, SHORT_HEADWAY_S)
        room_m = np.maximum(front.gap_m - ego.reference_standstill_gap_m - closing, 1.0)
        needed = closing * closing / (2 * room_m)
        brakes = (law < -ego.brake_m_s2 / 2) | (needed > BRAKES_FROM * ego.brake_m_s2)
        hard = law < -(ego.brake_m_s2 + ego.hard_brake_m_s2) / 2
        hard |= needed > BRAKES_FROM * ego.hard_brake_m_s2
        return np.where(hard, -ego.hard_brake_m_s2, np.where(brakes, -ego.brake_m_s2, 0.0))

    def _law(self, speed: FloatArray, front: NextVehicle, headway_s: float) -> FloatArray:
        """Return the acceleration of the time-gap law behind ``front``, m/s^2."""
        closing = speed - front.speed_m_s
        return time_gap_acceleration(speed, front.gap_m, closing, headway_s, self._ego)


def _is_passed_on_the_left(front: NextVehicle) -> BoolArray:
    """Return whether the rule of ``passing.py`` forbids the ego to pass ``front`` on its right."""
    banned: BoolArray = (front.gap_m > 0) & (front.speed_m_s > CONGESTED_M_S)
    return banned & (front.gap_m < FAR_M / 2)
