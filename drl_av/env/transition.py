"""One decision of an episode as one record, and the outcome of the ego's route in it."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from drl_av.driving.actions import Action
from drl_av.driving.affordances import FRONT, LANE, Indicators
from drl_av.driving.maneuver import aborts
from drl_av.driving.scene import Scene, unwritable
from drl_av.env.reward import Rewards
from drl_av.env.scene_values import Observation
from drl_av.errors import ConfigError
from drl_av.road.road import Road, lane_end_m, mandatory_change
from drl_av.road.snapshot import Collision
from drl_av.safety.check import Rule

EXIT_TAKEN, EXIT_MISSED = "exit taken", "exit missed"
MERGED, NOT_MERGED = "merged", "not merged"
COMPLETE = (EXIT_TAKEN, MERGED)
"""The outcomes of a route that the ego has completed."""


class Transition(NamedTuple):
    """One decision and its outcome: s_t, a_t, r_t+1 and s_t+1, with the two scenes."""

    scene: Scene
    """The scene before the decision."""
    observation: Observation
    """The observation of ``scene``, by default of shape (27,)."""
    proposed: Action
    """The driver's action. While SUMO drives the ego, the action nearest to the ego's motion."""
    executed: Action
    """The action after the safety check."""
    rule: Rule | str
    """The rules of the safety check that changed the action, or ``Rule.NONE``; a check of the user
    may name them by any text."""
    next_scene: Scene
    """The scene after the decision."""
    next_observation: Observation
    collision: Collision | None
    """The ego's collision within this decision, or None."""
    terms: Rewards
    """The three terms of the paper's reward in ``next_scene``."""
    reward: float
    """The mean of ``terms``, or r_col after a collision; or the value of the user's function."""
    terminated: bool
    """Whether the ego collided in this decision."""
    truncated: bool
    """Whether the ego made the last decision of the episode or reached the road's end."""
    route_outcome: str
    """``exit taken``, ``exit missed``, ``merged`` or ``not merged``; empty while it is open.

    In the last decision of an episode, an outcome that is still open becomes ``exit missed`` or
    ``not merged``. It is always empty on a road without an exit or a merge.
    """
    missed_exit: bool
    """Whether the ego has passed its exit without taking it."""

    @property
    def triggered(self) -> bool:
        """Whether the safety check names a rule, as it must if it replaced the proposed action."""
        return bool(self.rule)

    @property
    def failed(self) -> bool:
        """Whether the ego collided or has passed its exit without taking it.

        An ego that has not yet reached its exit or the end of its lane when the time is up has not
        failed, although ``route_outcome`` is then ``exit missed`` or ``not merged``. It could still
        take the exit or merge later, and the observation does not include the time.
        """
        return self.terminated or self.missed_exit

    @property
    def aborts_lane_change(self) -> bool:
        """Whether the executed action aborted a lane change in progress."""
        return aborts(self.scene.lane_change, self.executed.lateral)


RewardFunction = Callable[[Transition], float]
"""The user's reward of a transition, whose field ``reward`` is that of the paper."""


MOST_REWARD = 1e9
"""The largest size of a reward, from which single precision still learns."""


def custom_reward(function: RewardFunction, transition: Transition) -> float:
    """Return the reward of a transition that the user's own function computes.

    Raises:
        ConfigError: the function does not return a finite number of size ``MOST_REWARD`` at most.
    """
    with unwritable(function, transition.scene, transition.next_scene):
        reward = function(transition)
    if isinstance(reward, int | float | np.number) and abs(reward) <= MOST_REWARD:
        return float(reward)
    raise ConfigError(
        f"The reward function returned {reward!r}, but must return a finite number between "
        f"{-MOST_REWARD:g} and {MOST_REWARD:g}."
    )


class RouteOutcome:
    """The outcome of the ego's route in one episode.

    The route leads to the ego's exit. On a road without an exit, it leads out of the lane in which
    the ego starts, if that lane ends. Otherwise the ego has no route, and the outcome is always "".
    """

    def __init__(self, road: Road, start: Indicators) -> None:
        self._road, self._has_exit = road, road.exit_m < math.inf
        self._end_m, self._exit_lane = road.exit_m, road.exit_lane
        lane, front_m = place_of(start)
        if not self._has_exit and mandatory_change(lane, front_m, road)[0] != 0:
            self._end_m = lane_end_m(lane, front_m, road)
        self.reached = ""
        """The outcome, or "" while it is not decided."""

    def outcome(self, now: Indicators, over: bool) -> str:
        """Return the outcome of the route after a decision, or "" while it is not decided.

        The outcome is "exit taken" or "exit missed" on a road with an exit, otherwise "merged" or
        "not merged". It stays the same once it is decided. ``over`` says whether the episode ends
        with ``now``, by a collision or otherwise. If the outcome is still open then, it becomes
        "exit missed" or "not merged".
        """
        if self._end_m < math.inf and not self.reached:
            failed = EXIT_MISSED if self._has_exit else NOT_MERGED
            self.reached = self._passed(*place_of(now)) or failed * over
        return self.reached

    def misses_exit(self, now: Indicators) -> bool:
        """Return whether the ego has passed its exit without taking it."""
        return self._has_exit and self._road.misses_exit(*place_of(now))

    def _passed(self, lane: int, front_m: float) -> str:
        """Return the outcome that follows from the ego's place alone; "" if none does."""
        if front_m < self._end_m:
            return ""
        if not self._has_exit:
            return MERGED
        return EXIT_TAKEN if lane <= self._exit_lane else EXIT_MISSED


def place_of(found: Indicators) -> tuple[int, float]:
    """Return the ego's lane, and the position of its front bumper along the road, m."""
    return int(found.codes[LANE]), float(found.values[FRONT])
