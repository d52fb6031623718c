"""One decision of an episode as one record: ``HighwayEnv`` makes it, all other parts read it."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.driving.actions import Action
from drl_av.driving.maneuver import aborts
from drl_av.driving.scene import Scene, unwritable
from drl_av.env.reward import Rewards
from drl_av.errors import ConfigError
from drl_av.road.snapshot import Collision
from drl_av.safety.check import Rule

Observation = npt.NDArray[np.float32]


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
