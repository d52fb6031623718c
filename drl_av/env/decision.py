"""One decision of an episode, and what can be read from it."""

from typing import Any, NamedTuple

from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.maneuver import aborts
from drl_av.driving.scene import Scene
from drl_av.env.highway import Observation
from drl_av.safety.check import Rule
from drl_av.traffic.snapshot import Collision


class Decision(NamedTuple):
    """A transition of the environment: s_t, a_t, r_t+1 and s_t+1."""

    scene: Scene
    """What the decision rests on."""
    observation: Observation
    """The same, scaled, shape (27,)."""
    proposed: Action
    reward: float
    next_scene: Scene
    next_observation: Observation
    terminated: bool
    """The ego collided."""
    truncated: bool
    """The episode has had all its decisions."""
    info: dict[str, Any]
    """As ``HighwayEnv.step`` returned it."""

    @property
    def executed(self) -> Action:
        """The action that the safety check let the ego carry out."""
        number: int = self.info["executed_action"]
        return ACTIONS[number]

    @property
    def triggered(self) -> bool:
        """Whether any rule of the safety check fired."""
        return bool(self.info["rule"] != str(Rule.NONE))

    @property
    def collision(self) -> Collision | None:
        """The ego's collision within this decision, if any."""
        collision: Collision | None = self.info["collision"]
        return collision

    @property
    def aborts_lane_change(self) -> bool:
        """Whether the executed action turned a lane change in progress back."""
        return aborts(self.scene.lane_change, self.executed.lateral)
