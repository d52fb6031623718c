"""What an environment shows in each render mode, and the caption of an episode's moments."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium

from drl_av.drawing.panels import Caption
from drl_av.drawing.picture import Picture, draw
from drl_av.driving.actions import ACTIONS
from drl_av.traffic.road import Road
from drl_av.traffic.snapshot import Snapshot


def next_caption(caption: Caption, reward: float, info: dict[str, Any]) -> Caption:
    """The caption after one more decision, from the reward and ``info`` of its step."""
    rule, collision = info["rule"], info["collision"]
    return replace(
        caption,
        vehicles=info["vehicles"],
        seed=info["seed"],
        decision=caption.decision + 1,
        proposed=str(ACTIONS[info["proposed_action"]]),
        executed=str(ACTIONS[info["executed_action"]]),
        rule=None if rule == "none" else rule,
        reward=reward,
        **info["rewards"],
        speed_history=(*caption.speed_history, info["speed_m_s"]),
        trigger_history=(*caption.trigger_history, rule != "none"),
        collision="" if collision is None else collision.kind.value,
    )


class Renderer:
    """Draws nothing and remembers nothing: render mode None, and the base of the others."""

    def reset(self, snapshot: Snapshot, info: dict[str, Any]) -> None:
        """Begin an episode, with what the environment's ``reset`` returns."""

    def step(self, snapshot: Snapshot, reward: float, info: dict[str, Any]) -> None:
        """Go on by one decision, with what the environment's ``step`` returns."""

    def render(self) -> Picture | None:
        """The picture of the last moment; None from a renderer that makes no pictures."""
        return None


class PictureRenderer(Renderer):
    """Draws the last moment as a picture when it is asked to (render mode ``rgb_array``)."""

    def __init__(self, road: Road) -> None:
        self._road = road
        self._moment: tuple[Snapshot, Caption] | None = None

    def reset(self, snapshot: Snapshot, info: dict[str, Any]) -> None:
        """Begin the caption anew."""
        self._moment = snapshot, Caption(vehicles=info["vehicles"], seed=info["seed"])

    def step(self, snapshot: Snapshot, reward: float, info: dict[str, Any]) -> None:
        """Add the decision to the caption."""
        assert self._moment is not None
        self._moment = snapshot, next_caption(self._moment[1], reward, info)

    def render(self) -> Picture:
        """The picture, uint8 of shape (720, 1280, 3).

        Raises:
            gymnasium.error.ResetNeeded: no episode has begun.
        """
        if self._moment is None:
            raise gymnasium.error.ResetNeeded("There is nothing to draw yet: call reset.")
        snapshot, caption = self._moment
        return draw(snapshot, self._road, caption)


class GuiRenderer(Renderer):
    """Writes a line beside the ego in sumo-gui, which draws by itself (render mode ``human``)."""

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show = show

    def step(self, snapshot: Snapshot, reward: float, info: dict[str, Any]) -> None:
        """Show what was executed and why."""
        action, speed = ACTIONS[info["executed_action"]], info["speed_m_s"]
        self._show(f"{action} | rule: {info['rule']} | {speed:.1f} m/s | reward {reward:.2f}")
