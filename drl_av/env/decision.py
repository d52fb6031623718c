"""One decision of an episode: the transition of the environment, and its derived properties."""

from typing import Any, NamedTuple

from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.maneuver import aborts
from drl_av.driving.scene import Scene
from drl_av.env.highway import Observation
from drl_av.road.snapshot import Collision, CollisionKind
from drl_av.safety.check import Rule

NO_RULE = str(Rule.NONE)


class Decision(NamedTuple):
    """One transition of the environment: s_t, a_t, r_t+1 and s_t+1, with the two scenes."""

    scene: Scene
    """The scene before the decision."""
    observation: Observation
    """The scaled observation of ``scene``, by default of shape (27,)."""
    proposed: Action
    """The driver's action. While SUMO drives the ego, the action nearest to the ego's motion."""
    reward: float
    next_scene: Scene
    next_observation: Observation
    terminated: bool
    """Whether the ego collided in this decision."""
    truncated: bool
    """Whether the ego made the last decision of the episode or reached the road's end."""
    info: dict[str, Any]
    """The ``info`` that ``HighwayEnv.step`` returned."""
    missed_exit: bool = False
    """Whether the ego has passed its exit without taking it."""

    @property
    def executed(self) -> Action:
        """The action that the ego executed, after the safety check."""
        number: int = self.info["executed_action"]
        return ACTIONS[number]

    @property
    def triggered(self) -> bool:
        """Whether the safety check names a rule, as it must if it replaced the proposed action."""
        return bool(self.info["rule"] != NO_RULE)

    @property
    def collision(self) -> Collision | None:
        """The ego's collision within this decision, or None."""
        if not self.info["collision"]:
            return None
        other = self.info["collided_with"] or None
        return Collision(CollisionKind(self.info["collision"]), other)

    @property
    def failed(self) -> bool:
        """Whether the ego collided or has passed its exit without taking it.

        An ego that has not yet reached its exit or the end of its lane when the time is up has not
        failed, although ``info["way"]`` is then ``exit missed`` or ``not merged``. It could still
        take the exit or merge later, and the observation does not include the time.
        """
        return self.terminated or self.missed_exit

    @property
    def aborts_lane_change(self) -> bool:
        """Whether the executed action aborted a lane change in progress."""
        return aborts(self.scene.lane_change, self.executed.lateral)
