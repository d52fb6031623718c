"""Models human drivers around the ego in the simulator, and an adversary among them.

Each vehicle decides once a second. It follows the intelligent driver model (IDM), calibrated to
highD (Zhang and Sun), with noise; at random it brakes hard or changes lanes. The frequencies are
those of the naturalistic driving data in Comparison-DenseLearning-ProvablySafeRL at 30 m/s. Speeds
and ranges at the start are those of the SPMD and IVBSS studies. If the model would brake hard at
once, the range is widened, because people in these studies do not brake so. The adversary makes
dangerous acts near the ego more frequent; the importance weight of each scene removes this bias.
"""

from typing import NamedTuple

import numpy as np

from drl_av.arrays import BoolArray, FloatArray, IntArray
from drl_av.config import Config
from drl_av.driving.car_following import Idm
from verification.adversary import LENGTH_M, ROAD, Mover, Orders, World
from verification.families import needed_gap, placed

HIGHD = Idm(1.17, 3.22, 1.46, 2.40)
"""IDM of highD, population means: headway, standstill gap, acceleration, comfortable braking."""
SPEED_M_S, SPEED_SD_M_S, RELATIVE_SD_M_S = 30.05, 3.48, 1.3
"""Speed (mean, standard deviation) and relative speed of two vehicles, in SPMD and IVBSS."""
RANGE_M, RANGE_LOG_SD = 34.0, 0.57
"""Range to the vehicle ahead: a lognormal distribution with the percentiles 18, 34 and 77 m at 10,
50 and 90 percent."""
NOISE_M_S2 = 0.38
"""Standard deviation of the acceleration on a free road at 30 m/s."""
HARD_BRAKES_PER_S, HARD_BRAKE_M_S2 = 4e-3, (3.0, 4.0)
"""Frequency and strength of hard braking without a reason ahead."""
LANE_CHANGES_PER_S = 1.25e-3
"""Frequency of lane changes to each side."""
CARELESS_SHARE = 0.01
"""Share of careless lane changes, which ignore the vehicle behind in the new lane (ours)."""
SAFE_BRAKING_M_S2 = 3.0
"""Hardest braking that a careful lane change may require of others, as in D2RL's MOBIL."""
LATERAL_M_S, LATERAL_SD_M_S, LATERAL_LIMITS_M_S = 1.2, 0.35, (0.5, 2.6)
"""Lateral speed of a lane change: mean, standard deviation and limits, for cars in exiD."""
EMERGENCY_BRAKING_M_S2 = 9.0
PER_LANE = 3
"""Number of vehicles in each lane."""


class Frequencies(NamedTuple):
    """Probabilities per second of dangerous acts near the ego."""

    hard_brake: float
    """The vehicle ahead of the ego brakes hard."""
    lane_change: float
    """A vehicle beside or ahead of the ego changes into the ego's lane."""
    careless: float
    """Share (no probability per second) of these lane changes that are careless."""


PEOPLE = Frequencies(HARD_BRAKES_PER_S, LANE_CHANGES_PER_S, CARELESS_SHARE)
ADVERSARY = Frequencies(0.03, 0.02, 0.5)
NEAR_M = (-6.0, 30.0)
"""A lane change into the ego's lane is dangerous if the vehicle's centre is ahead of the ego's
centre by a distance in this interval."""


class UnboundedMover(Mover):
    """A Mover that does not restrict the other vehicles to the bounds of ``strict``."""

    def __init__(self, config: Config) -> None:
        bounds = {"braking_m_s2": EMERGENCY_BRAKING_M_S2, "acceleration_m_s2": 2.0}
        fastest = {"lateral_speed_m_s": LATERAL_LIMITS_M_S[1]}
        super().__init__(config.updated("strict", **bounds, **fastest))

    def _permitted_side(
        self, world: World, side: FloatArray, rate: FloatArray, from_x_m: FloatArray
    ) -> FloatArray:
        return side

    def _staying_behind(self, world: World, wanted: FloatArray) -> FloatArray:
        return wanted


def starts(scenes: int, config: Config, rng: np.random.Generator) -> World:
    """Draw scenes with three vehicles in each of three lanes around the ego.

    The ego does not choose the start. The gaps to the two vehicles ahead of it are therefore at
    least as large as its check requires. All other gaps are at least ``unhurried_gap``.
    """
    flow = np.clip(rng.normal(SPEED_M_S, SPEED_SD_M_S, (scenes, 1)), 20.0, 40.0)
    lanes = np.repeat(np.arange(3), PER_LANE)
    shape = (scenes, len(lanes))
    speed = np.clip(flow + rng.normal(0, RELATIVE_SD_M_S / np.sqrt(2), shape), 15.0, 40.0)
    ego_lane, ego = rng.integers(0, 3, scenes), np.minimum(flow[:, 0], config.ego.max_speed_m_s)
    pitch_m = LENGTH_M + RANGE_M * np.exp(RANGE_LOG_SD * rng.normal(size=shape))
    x_m = np.empty(shape)
    for lane in range(3):
        first, own = PER_LANE * lane, ego_lane == lane
        ahead_of_last = np.where(own, ego, speed[:, first])
        speeds = (speed[:, first], speed[:, first + 1]), (speed[:, first + 2], ahead_of_last)
        for row, (behind, ahead) in enumerate(speeds, first + 1):
            pitch_m[:, row] = np.maximum(pitch_m[:, row], LENGTH_M + unhurried_gap(behind, ahead))
        beside_m = rng.uniform(-0.5, 0.5, scenes) * pitch_m[:, first]
        required_m = [
            LENGTH_M + needed_gap(ego, speed[:, each], config) for each in (first, first + 1)
        ]
        x_m[:, first] = np.where(own, np.maximum(pitch_m[:, first], required_m[0]), beside_m)
        x_m[:, first + 1] = x_m[:, first] + pitch_m[:, first + 1]
        second_m = np.maximum(x_m[:, first + 1], required_m[1])
        x_m[:, first + 1] = np.where(own, second_m, x_m[:, first + 1])
        behind_of_m = np.where(own, 0.0, x_m[:, first])
        x_m[:, first + 2] = behind_of_m - pitch_m[:, first + 2]
    return placed(ego_lane, ego, x_m, np.broadcast_to(lanes, shape), speed)


class Traffic:
    """Decides for the human drivers, or the adversary among them, in many scenes.

    Args:
        world: The scenes at their start.
        frequencies: Probabilities of dangerous acts near the ego. With ``PEOPLE`` there is no
            adversary, and all weights are 1.
        rng: The source of all random numbers.
        careless: Share of careless lane changes among the human drivers.
    """

    def __init__(
        self,
        world: World,
        frequencies: Frequencies,
        rng: np.random.Generator,
        careless: float = CARELESS_SHARE,
    ) -> None:
        shape = world.x_m[:, 1:].shape
        self.weights = np.ones(shape[0])
        """Importance weights, (scenes,): the probability of all acts so far without the adversary,
        divided by their probability with the adversary."""
        self._frequencies, self._rng, self._careless = frequencies, rng, careless
        self._desired_m_s = world.speed_m_s[:, 1:] + np.abs(rng.normal(0, 2.0, shape)) + 1.0
        self._target = np.round(world.y_m[:, 1:] / ROAD.lane_width_m).astype(np.int64)
        drawn = rng.normal(LATERAL_M_S, LATERAL_SD_M_S, shape)
        self._lateral_m_s = np.clip(drawn, *LATERAL_LIMITS_M_S)

    def decide(self, world: World, proposal: IntArray) -> Orders:
        """Decide for the next second; return all commands, with the ego's action ``proposal``."""
        gap_m, leader = _leaders(world, self._target)
        acceleration = self._following(world, gap_m, leader)
        columns = np.arange(1, world.x_m.shape[1])
        ahead = (leader[:, :1] == columns) & (gap_m[:, :1] < RANGE_M)
        brakes = self._happens(
            np.where(ahead, self._frequencies.hard_brake, HARD_BRAKES_PER_S), HARD_BRAKES_PER_S
        )
        hard = -self._rng.uniform(*HARD_BRAKE_M_S2, brakes.shape)
        acceleration = np.where(brakes, np.minimum(acceleration, hard), acceleration)
        self._change_lanes(world)
        to_m = self._target * ROAD.lane_width_m - world.y_m[:, 1:]
        side = np.where(np.abs(to_m) > 1e-3, np.sign(to_m), 0.0)
        return Orders(proposal, acceleration, side * self._lateral_m_s / LATERAL_LIMITS_M_S[1])

    def _following(self, world: World, gap_m: FloatArray, leader: IntArray) -> FloatArray:
        speed = world.speed_m_s[:, 1:]
        other = np.take_along_axis(world.speed_m_s, np.maximum(leader, 0), 1)[:, 1:]
        closing = np.where(leader[:, 1:] >= 0, speed - other, 0.0)
        noise = self._rng.normal(0, NOISE_M_S2, speed.shape)
        followed = _idm(speed, self._desired_m_s, gap_m[:, 1:], closing)
        return np.clip(followed + noise, -EMERGENCY_BRAKING_M_S2, 2.0)

    def _change_lanes(self, world: World) -> None:
        """Draw which vehicles begin a lane change; they complete it."""
        often = self._frequencies
        lane = np.round(world.y_m / ROAD.lane_width_m).astype(np.int64)
        still = np.abs(world.y_m[:, 1:] - self._target * ROAD.lane_width_m) < 1e-3
        ahead_m = world.x_m[:, 1:] - world.x_m[:, :1]
        near = still & (NEAR_M[0] < ahead_m) & (ahead_m < NEAR_M[1])
        for side in (-1, 1):
            into = lane[:, 1:] + side
            possible = still & (into >= 0) & (into < 3)
            dangerous = near & possible & (into == lane[:, :1])
            attempts = self._attempts(world, side, possible, dangerous)
            share = np.where(dangerous, max(often.careless, self._careless), self._careless)
            careless = self._happens(share, self._careless, attempts)
            room, careful = _room(world, self._target, into)
            begins = attempts & room & (careful | careless)
            self._target = np.where(begins, into, self._target)
            still &= ~begins

    def _attempts(
        self, world: World, side: int, possible: BoolArray, dangerous: BoolArray
    ) -> BoolArray:
        """Draw which vehicles try to change lanes to ``side``: right -1, left 1."""
        frequency = np.where(dangerous, self._frequencies.lane_change, LANE_CHANGES_PER_S)
        return possible & self._happens(frequency, LANE_CHANGES_PER_S, possible)

    def _happens(
        self, frequency: FloatArray, among_people: float, counts: BoolArray | None = None
    ) -> BoolArray:
        """Draw events with the probabilities ``frequency``, shape (scenes, others); return them.

        The weight of each scene is multiplied by the ratio of the probability ``among_people`` to
        the probability drawn from. Only the events in ``counts`` happen and change the weight; None
        means all events.
        """
        happens = self._rng.random(frequency.shape) < frequency
        ratio = np.where(happens, among_people / frequency, (1 - among_people) / (1 - frequency))
        counts = np.ones(frequency.shape, np.bool_) if counts is None else counts
        self.weights *= np.where(counts, ratio, 1.0).prod(axis=1)
        return happens & counts


def _idm(
    speed: FloatArray, desired: FloatArray | float, gap_m: FloatArray, closing: FloatArray
) -> FloatArray:
    """Return the acceleration of the IDM with the parameters ``HIGHD``, m/s^2.

    This is ``car_following.idm_acceleration`` for arrays. ``closing`` is the speed at which the gap
    shrinks, m/s.
    """
    interaction = (_wanted_gap(speed, closing) / np.maximum(gap_m, 0.01)) ** 2
    return HIGHD.acceleration_m_s2 * (1 - (speed / desired) ** 4 - interaction)


def _wanted_gap(speed: FloatArray, closing: FloatArray) -> FloatArray:
    """Return the gap that the IDM desires, m."""
    spread = 2 * np.sqrt(HIGHD.acceleration_m_s2 * HIGHD.comfortable_braking_m_s2)
    result: FloatArray = HIGHD.standstill_gap_m + np.maximum(
        0.0, speed * HIGHD.headway_s + speed * closing / spread
    )
    return result


def unhurried_gap(speed: FloatArray, ahead: FloatArray) -> FloatArray:
    """Return the smallest gap at which the IDM does not brake hard, m.

    ``speed`` is the driver's speed, ``ahead`` that of the vehicle ahead, m/s. The desired speed is
    at least 1 m/s higher than ``speed``, as it is in ``Traffic``.
    """
    free = 1 - (speed / (speed + 1.0)) ** 4
    braking = HARD_BRAKE_M_S2[0] / HIGHD.acceleration_m_s2
    return _wanted_gap(speed, speed - ahead) / np.sqrt(free + braking)


def _lanes(world: World, target: IntArray) -> tuple[IntArray, IntArray]:
    """Return the lane of each vehicle's centre, and the lane that it moves into.

    For the other vehicles the latter is ``target``, shape (scenes, others), or their own lane. Both
    have shape (scenes, 1 + others), the ego in column 0.
    """
    lane = np.round(world.y_m / ROAD.lane_width_m).astype(np.int64)
    own = np.where(world.target < 0, lane[:, 0], world.target)
    return lane, np.column_stack([own, target])


def _leaders(world: World, target: IntArray) -> tuple[FloatArray, IntArray]:
    """Return each vehicle's gap to the vehicle ahead, m, and the column of that vehicle.

    Without a vehicle ahead these are inf and -1. Both have shape (scenes, 1 + others), the ego in
    column 0. A vehicle is in both of its ``_lanes``.
    """
    lane, bound = _lanes(world, target)
    either = (lane[:, :, None] == lane[:, None]) | (lane[:, :, None] == bound[:, None])
    either |= (bound[:, :, None] == lane[:, None]) | (bound[:, :, None] == bound[:, None])
    lead_m = world.x_m[:, None, :] - world.x_m[:, :, None]
    lead_m = np.where(either & (lead_m > 0), lead_m, np.inf)
    nearest_m = lead_m.min(axis=2)
    leader = np.where(np.isinf(nearest_m), -1, lead_m.argmin(axis=2))
    return nearest_m - LENGTH_M, leader


def _room(world: World, target: IntArray, into: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return whether each vehicle can change to the lane ``into``, and whether that is careful.

    A vehicle can change if no vehicle is beside it in that lane, and if it need not brake hard for
    the vehicle ahead. The lane change is careful if the vehicle behind need not brake hard either.
    Both arrays have shape (scenes, others).
    """
    lane, bound = _lanes(world, target)
    there = (lane[:, None] == into[:, :, None]) | (bound[:, None] == into[:, :, None])
    lead_m = world.x_m[:, None, :] - world.x_m[:, 1:, None]
    n = lead_m.shape[1]
    there[:, np.arange(n), np.arange(1, n + 1)] = False
    ahead_m = np.where(there & (lead_m > 0), lead_m, np.inf)
    gap_m, leader = ahead_m.min(axis=2) - LENGTH_M, ahead_m.argmin(axis=2)
    own_m_s, other = world.speed_m_s[:, 1:], np.take_along_axis(world.speed_m_s, leader, 1)
    brakes = np.where(np.isinf(gap_m), 0.0, _idm(own_m_s, own_m_s + 1.0, gap_m, own_m_s - other))
    beside = (there & (np.abs(lead_m) <= LENGTH_M)).any(axis=2)
    room = ~beside & (brakes > -SAFE_BRAKING_M_S2)
    behind_m = np.where(there & (lead_m < 0), -lead_m, np.inf)
    gap_m, follower = behind_m.min(axis=2) - LENGTH_M, behind_m.argmin(axis=2)
    speed = np.take_along_axis(world.speed_m_s, follower, 1)
    imposed = _idm(speed, speed + 1.0, gap_m, speed - own_m_s)
    careful = np.isinf(gap_m) | (imposed > -SAFE_BRAKING_M_S2)
    return room, careful
