"""The metrics of an episode: every column of the tables of evaluation and of training."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from drl_av.driving.actions import Longitudinal
from drl_av.env.decision import Decision
from drl_av.files import PossiblyInfinite
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
    """The kind of the collision in words; empty without one."""
    safety_triggers: int
    """Decisions that the safety check changed."""
    lane_changes: int
    """Lane changes that ended in another lane than they began in."""
    aborted_lane_changes: int
    min_ttc_s: PossiblyInfinite
    """Smallest time to collision with the vehicle ahead; inf where it never closed."""
    min_headway_s: PossiblyInfinite
    """Smallest time gap to the vehicle ahead; inf where there was none."""
    hard_brakes: int
    d_safe_violations: int
    """Decisions after which the vehicle ahead was nearer than d_safe, where r_x is below 0."""


class EpisodeMetrics:
    """The metrics of one episode, from its decisions added one after another.

    Each decision counts with the scene after it; the scene of the reset does not count.
    The means need at least one decision.
    """

    def __init__(self) -> None:
        self.speeds_m_s: list[float] = []
        """The ego's, after each decision."""
        self.rewards: list[float] = []
        """The reward of each decision, with a collision's."""
        self.safety_triggers = 0
        self.lane_changes = 0
        self.aborted_lane_changes = 0
        self.hard_brakes = 0
        self.d_safe_violations = 0
        self.min_ttc_s = math.inf
        self.min_headway_s = math.inf
        self.collision: Collision | None = None
        self._r_v: list[float] = []
        self._r_y: list[float] = []
        self._r_x: list[float] = []
        self._settled_lane: int | None = None

    def add(self, decision: Decision) -> None:
        """Count the next decision of the episode."""
        terms = decision.info["rewards"]
        self.speeds_m_s.append(decision.next_scene.affordances.ego_speed_m_s)
        self.rewards.append(decision.reward)
        self._r_v.append(terms["r_v"])
        self._r_y.append(terms["r_y"])
        self._r_x.append(terms["r_x"])
        self.safety_triggers += decision.triggered
        self.hard_brakes += decision.executed.longitudinal == Longitudinal.HARD_BRAKE
        self.d_safe_violations += terms["r_x"] < 0
        self.collision = decision.collision
        self._add_lane_change(decision)
        self._add_leader(decision)

    def _add_lane_change(self, decision: Decision) -> None:
        if self._settled_lane is None:
            self._settled_lane = decision.scene.affordances.lane
        self.aborted_lane_changes += decision.aborts_lane_change
        lane = decision.next_scene.affordances.lane
        if decision.next_scene.lane_change is None and lane != self._settled_lane:
            self.lane_changes += 1
            self._settled_lane = lane

    def _add_leader(self, decision: Decision) -> None:
        front = decision.next_scene.affordances.own_front
        if front is None:
            return
        speed = decision.next_scene.affordances.ego_speed_m_s
        ttc_s = time_to_collision(front.gap_m, closing_speed(front))
        self.min_ttc_s = min(self.min_ttc_s, ttc_s)
        self.min_headway_s = min(self.min_headway_s, front.gap_m / speed if speed > 0 else math.inf)

    @property
    def decisions(self) -> int:
        """Decisions of the episode so far."""
        return len(self.rewards)

    @property
    def mean_speed_m_s(self) -> float:
        """Mean speed of the ego."""
        return _mean(self.speeds_m_s)

    @property
    def mean_reward(self) -> float:
        """Mean reward a decision, with a collision's."""
        return _mean(self.rewards)

    @property
    def collided(self) -> bool:
        """Whether the ego hit something or was hit."""
        return self.collision is not None

    @property
    def ego_hit(self) -> bool:
        """Whether the ego hit something, rather than being hit."""
        return self.collision is not None and self.collision.kind.ego_hit

    def result(self, driver: str, safety_check: str, vehicles: int, seed: int) -> EpisodeResult:
        """The row of the episode, beside what it was driven with."""
        return EpisodeResult(
            driver=driver,
            safety_check=safety_check,
            vehicles=vehicles,
            seed=seed,
            decisions=self.decisions,
            mean_speed_m_s=self.mean_speed_m_s,
            mean_reward=self.mean_reward,
            mean_r_v=_mean(self._r_v),
            mean_r_y=_mean(self._r_y),
            mean_r_x=_mean(self._r_x),
            collided=self.collided,
            ego_hit=self.ego_hit,
            collision="" if self.collision is None else self.collision.kind.value,
            safety_triggers=self.safety_triggers,
            lane_changes=self.lane_changes,
            aborted_lane_changes=self.aborted_lane_changes,
            min_ttc_s=self.min_ttc_s,
            min_headway_s=self.min_headway_s,
            hard_brakes=self.hard_brakes,
            d_safe_violations=self.d_safe_violations,
        )


def _mean(values: Sequence[float]) -> float:
    """Summed in the order of the decisions; numpy and ``sum`` differ from it in the last bit."""
    total = 0.0
    for value in values:
        total += value
    return total / len(values)
