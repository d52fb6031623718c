"""One decision of an episode: the transition of the environment, and facts derived from it."""

from typing import Any, NamedTuple

from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.maneuver import aborts
from drl_av.driving.scene import Scene
from drl_av.env.highway import Observation
from drl_av.safety.check import Rule
from drl_av.traffic.snapshot import Collision, CollisionKind


class Decision(NamedTuple):
    """A transition of the environment: s_t, a_t, r_t+1 and s_t+1."""

    scene: Scene
    """The scene before the decision, its input."""
    observation: Observation
    """The scaled observation of that scene, shape (27,)."""
    proposed: Action
    """The driver's action; while SUMO drives the ego, the action nearest to what it did."""
    reward: float
    next_scene: Scene
    next_observation: Observation
    terminated: bool
    """Whether the ego collided."""
    truncated: bool
    """Whether the decision was the last that the episode may have."""
    info: dict[str, Any]
    """The ``info`` that ``HighwayEnv.step`` returned."""

    @property
    def executed(self) -> Action:
        """The action that the ego carried out after the safety check."""
        number: int = self.info["executed_action"]
        return ACTIONS[number]

    @property
    def triggered(self) -> bool:
        """Whether any rule of the safety check fired."""
        return bool(self.info["rule"] != str(Rule.NONE))

    @property
    def collision(self) -> Collision | None:
        """The ego's collision within this decision, or None."""
        if not self.info["collision"]:
            return None
        other = self.info["collided_with"] or None
        return Collision(CollisionKind(self.info["collision"]), other)

    @property
    def aborts_lane_change(self) -> bool:
        """Whether the executed action aborted a lane change in progress."""
        return aborts(self.scene.lane_change, self.executed.lateral)
