"""The metrics of an episode: the columns of the evaluation and training tables."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from drl_av.driving.actions import Longitudinal
from drl_av.driving.affordances import Neighbor
from drl_av.driving.scene import Scene
from drl_av.env.reward import Rewards
from drl_av.env.transition import COMPLETE, Transition
from drl_av.files.table import PossiblyInfinite
from drl_av.road.snapshot import EGO, Collision
from drl_av.safety.paper import closing_speed, time_to_collision

CHANGE_M_S = 0.3
"""A larger change of speed in a decision counts as accelerating or braking."""
SHORT_HEADWAY_S = 1.0
CRAWLING_M_S = 5.0
"""At this speed and below, a headway does not count as short."""
FORCED_M_S2 = 2.0
"""During a lane change of the ego, harder braking of the vehicle behind it counts as forced."""


@dataclass(frozen=True)
class EpisodeResult:
    """One row of the table of ``drl-av evaluate``; means are over the decisions of the episode."""

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
    """Whether the ego hit something; False if another vehicle hit the ego."""
    collision: str
    """The kind of the collision in words; empty without one."""
    safety_triggers: int
    """Number of decisions that the safety check changed."""
    lane_changes: int
    """Number of completed lane changes."""
    aborted_lane_changes: int
    """Number of decisions in which the ego turns back; a lane change may have several."""
    min_ttc_s: PossiblyInfinite
    """Smallest time to collision with the vehicle ahead; inf if the gap never shrank. For this and
    the next column, the end of the ego's lane counts as a standing vehicle."""
    min_headway_s: PossiblyInfinite
    """Smallest time gap to the vehicle ahead; inf if there never was such a vehicle."""
    hard_brakes: int
    """Number of decisions with the action hard brake."""
    d_safe_violations: int
    """Number of decisions after which the gap to the vehicle ahead was below d_safe (r_x < 0)."""
    way: str = field(default="", kw_only=True)
    """``exit taken``, ``exit missed``, ``merged`` or ``not merged``; "" if the ego has no way."""
    world: str = field(default="sumo", kw_only=True)
    """The world in which it was driven, ``sumo`` or ``twin``."""
    group: str = field(default="", kw_only=True)
    """The name under which several trainings are compared, such as ``ppo`` for ``ppo/seed-1``; the
    driver's own name beside such a group; "" in an evaluation without groups."""

    @property
    def missed(self) -> bool:
        """Whether the ego missed its exit, or did not merge where its lane ends."""
        return self.way not in ("", *COMPLETE)

    @property
    def compared_as(self) -> str:
        """The name of the driver's group, or of the driver if there are no groups."""
        return self.group or self.driver

    @property
    def is_training(self) -> bool:
        """Whether the driver is one of the trainings of a group."""
        return self.compared_as != self.driver

    def cells(self) -> dict[str, Any]:
        """Return the row's values by column; ``way`` is there if the ego has one, ``world`` if it
        is not SUMO, and ``group`` if there are groups.
        """
        return {name: value for name, value in asdict(self).items() if USUAL.get(name) != value}


USUAL = {"way": "", "world": "sumo", "group": ""}
"""The columns that a table lacks if they have these values."""


def leader(scene: Scene) -> Neighbor | None:
    """Return what the ego would run into in its lane: the next vehicle, or the lane's end.

    A vehicle that reaches into the lane beside the ego, without overlapping it, is none; who is
    ahead of that one does not count then, either.
    """
    front, shot = scene.affordances.own_front, scene.snapshot
    if front is None or front.gap_m > 0.0 or front.vehicle >= len(shot.ids):
        return front
    apart_m = float(shot.width_m[front.vehicle] + shot.width_m[EGO]) / 2
    return front if abs(front.lateral_offset_m) < apart_m else None


class EpisodeMetrics:
    """Computes the metrics of one episode from its decisions.

    The metrics use the scene after each decision; they do not use the scene after the reset. The
    means need at least one decision.
    """

    def __init__(self) -> None:
        self.speeds_m_s: list[float] = []
        """The ego's speed after each decision."""
        self.rewards: list[float] = []
        """The reward of each decision, including that of a collision."""
        self.safety_triggers = 0
        self.lane_changes = 0
        self.aborted_lane_changes = 0
        self.hard_brakes = 0
        self.d_safe_violations = 0
        self.min_ttc_s = math.inf
        self.min_headway_s = math.inf
        self.collision: Collision | None = None
        self.way = ""
        self._terms: list[Rewards] = []
        self._settled_lane: int | None = None

    def add(self, decision: Transition) -> None:
        """Update the metrics with the next decision of the episode."""
        self._terms.append(decision.terms)
        self.speeds_m_s.append(decision.next_scene.affordances.ego_speed_m_s)
        self.rewards.append(decision.reward)
        self.safety_triggers += decision.triggered
        self.hard_brakes += decision.executed.longitudinal == Longitudinal.HARD_BRAKE
        self.d_safe_violations += decision.terms.r_x < 0
        self.collision = decision.collision
        self.way = decision.route_outcome
        self._add_lane_change(decision)
        self._add_leader(decision)

    def _add_lane_change(self, decision: Transition) -> None:
        """Count a lane change that the decision aborted or completed."""
        if self._settled_lane is None:
            self._settled_lane = decision.scene.affordances.lane
        self.aborted_lane_changes += decision.aborts_lane_change
        lane = decision.next_scene.affordances.lane
        if decision.next_scene.lane_change is None and lane != self._settled_lane:
            self.lane_changes += 1
            self._settled_lane = lane

    def _add_leader(self, decision: Transition) -> None:
        """Update the smallest time to collision and time gap, if there is a vehicle ahead."""
        front = leader(decision.next_scene)
        if front is None:
            return
        speed = decision.next_scene.affordances.ego_speed_m_s
        ttc_s = time_to_collision(front.gap_m, closing_speed(front))
        self.min_ttc_s = min(self.min_ttc_s, ttc_s)
        self.min_headway_s = min(self.min_headway_s, front.gap_m / speed if speed > 0 else math.inf)

    @property
    def decisions(self) -> int:
        """Number of decisions so far."""
        return len(self.rewards)

    @property
    def mean_speed_m_s(self) -> float:
        """Mean speed of the ego, m/s."""
        return _mean(self.speeds_m_s)

    @property
    def mean_reward(self) -> float:
        """Mean reward of the decisions, including the decision in which the ego collided."""
        return _mean(self.rewards)

    @property
    def collided(self) -> bool:
        """Whether the ego was in a collision."""
        return self.collision is not None

    @property
    def ego_hit(self) -> bool:
        """Whether the ego hit something; False if another vehicle hit the ego."""
        return self.collision is not None and self.collision.kind.ego_hit

    def result(self, driver: str, safety_check: str, vehicles: int, seed: int) -> EpisodeResult:
        """Return the table's row for the episode: the four arguments and the metrics."""
        found: dict[str, Any] = {"driver": driver, "safety_check": safety_check, "seed": seed}
        found |= {"vehicles": vehicles, **self.columns(EpisodeResult)}
        found["collision"] = "" if self.collision is None else self.collision.kind.value
        for name in Rewards._fields:
            found[f"mean_{name}"] = _mean([getattr(terms, name) for terms in self._terms])
        return EpisodeResult(**found)

    def columns(self, kind: type[EpisodeResult]) -> dict[str, Any]:
        """Return the columns of ``kind`` that are attributes of the same name, with their values.

        An attribute that is None is left out.
        """
        values = {item.name: getattr(self, item.name, None) for item in fields(kind)}
        return {name: value for name, value in values.items() if value is not None}


def _mean(values: Sequence[float]) -> float:
    """Return the mean, added in order: numpy and ``sum`` could differ in the last bit."""
    total = 0.0
    for value in values:
        total += value
    return total / len(values)
