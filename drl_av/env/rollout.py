"""One episode driven from its first decision to its last, and what it came to."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from drl_av.drivers.driver import Driver
from drl_av.driving.actions import ACTIONS, Longitudinal
from drl_av.driving.scene import LaneChange
from drl_av.env.highway import HighwayEnv
from drl_av.safety.paper import closing_speed, time_to_collision
from drl_av.traffic.snapshot import Collision


@dataclass(frozen=True)
class EpisodeResult:
    """A row of ``evaluate``'s CSV file; means are over the decisions of the episode."""

    driver: str
    safety_check: str
    vehicles: int
    seed: int
    decisions: int
    mean_speed_m_s: float
    mean_reward: float
    mean_r_v: float
    mean_r_y: float
    mean_r_x: float
    collided: bool
    ego_hit: bool
    """The ego hit something, rather than being hit."""
    collision: str
    """What it was, in words; empty without one."""
    safety_triggers: int
    """Decisions that the safety check changed."""
    lane_changes: int
    """Lane changes that ended in another lane than they began in."""
    aborted_lane_changes: int
    min_ttc_s: float
    """Smallest time to collision with the vehicle ahead; inf where it never closed."""
    min_headway_s: float
    """Smallest time gap to the vehicle ahead; inf where there was none."""
    hard_brakes: int
    d_safe_violations: int
    """Decisions after which the vehicle ahead was nearer than d_safe, where r_x is below 0."""


def drive(
    env: HighwayEnv,
    driver: Driver,
    name: str,
    seed: int,
    vehicles: int,
    watch: Callable[[HighwayEnv], None] | None = None,
) -> EpisodeResult:
    """Drive one episode; ``watch`` is called after the reset and after each decision."""
    observation, _ = env.reset(seed=seed, options={"vehicles": vehicles})
    driver.start(seed)
    if watch:
        watch(env)
    tally = _Tally(env)
    over = False
    while not over:
        action = driver.act(env.scene, observation)
        observation, reward, terminated, truncated, info = env.step(action.number)
        tally.add(reward, info)
        over = terminated or truncated
        if watch:
            watch(env)
    return tally.result(name, seed, vehicles)


class _Tally:
    """Sums over the decisions of one episode."""

    def __init__(self, env: HighwayEnv) -> None:
        self._env = env
        self._numbers: list[tuple[float, ...]] = []
        self._settled_lane = env.scene.affordances.lane
        self._lane_change: LaneChange | None = None
        names = ("triggers", "changes", "aborts", "hard_brakes", "d_safe_violations")
        self._counts = dict.fromkeys(names, 0)
        self._headway_s, self._ttc_s = math.inf, math.inf
        self._collision: Collision | None = None

    def add(self, reward: float, info: dict[str, Any]) -> None:
        affordances = self._env.scene.affordances
        self._numbers.append((affordances.ego_speed_m_s, reward, *info["rewards"].values()))
        self._counts["triggers"] += info["rule"] != "none"
        self._counts["d_safe_violations"] += info["rewards"]["r_x"] < 0
        executed = ACTIONS[info["executed_action"]]
        self._counts["hard_brakes"] += executed.longitudinal == Longitudinal.HARD_BRAKE
        before, self._lane_change = self._lane_change, self._env.scene.lane_change
        if before is not None and executed.lateral.sign == -before.sign:
            self._counts["aborts"] += 1
        if self._lane_change is None and affordances.lane != self._settled_lane:
            self._counts["changes"] += 1
            self._settled_lane = affordances.lane
        if affordances.own_front is not None:
            gap_m, speed = affordances.own_front.gap_m, affordances.ego_speed_m_s
            ttc_s = time_to_collision(gap_m, closing_speed(affordances.own_front))
            self._ttc_s = min(self._ttc_s, ttc_s)
            self._headway_s = min(self._headway_s, gap_m / speed if speed > 0 else math.inf)
        self._collision = info["collision"]

    def result(self, name: str, seed: int, vehicles: int) -> EpisodeResult:
        speed, reward, r_v, r_y, r_x = np.mean(self._numbers, axis=0).tolist()
        collision = self._collision
        return EpisodeResult(
            driver=name,
            safety_check=self._env.check_name,
            vehicles=vehicles,
            seed=seed,
            decisions=len(self._numbers),
            mean_speed_m_s=speed,
            mean_reward=reward,
            mean_r_v=r_v,
            mean_r_y=r_y,
            mean_r_x=r_x,
            collided=collision is not None,
            ego_hit=collision is not None and collision.kind.ego_hit,
            collision="" if collision is None else collision.kind.value,
            safety_triggers=self._counts["triggers"],
            lane_changes=self._counts["changes"],
            aborted_lane_changes=self._counts["aborts"],
            min_ttc_s=self._ttc_s,
            min_headway_s=self._headway_s,
            hard_brakes=self._counts["hard_brakes"],
            d_safe_violations=self._counts["d_safe_violations"],
        )
