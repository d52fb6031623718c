"""The renderers of the environment's render modes, and the captions of their pictures."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import gymnasium

from drl_av.drawing.canvas import EGO_COLOR, Color, speed_color
from drl_av.drawing.panels import Caption
from drl_av.drawing.picture import Picture, draw
from drl_av.driving.scene import Scene
from drl_av.env.transition import Transition
from drl_av.road.road import Road
from drl_av.road.snapshot import EGO, Snapshot


def next_caption(caption: Caption, decision: Transition, road: Road) -> Caption:
    """Return the caption after the next decision of the episode on this road."""
    after, collision = decision.next_scene, decision.collision
    return replace(
        caption,
        vehicles=len(after.snapshot.ids) - 1,
        decision=caption.decision + 1,
        proposed=str(decision.proposed),
        executed=str(decision.executed),
        lane_change=_lane_change(after, road),
        rule=str(decision.rule) if decision.triggered else None,
        reward=decision.reward,
        **decision.terms._asdict(),
        speed_history=(*caption.speed_history, after.affordances.ego_speed_m_s),
        trigger_history=(*caption.trigger_history, decision.triggered),
        collision="" if collision is None else collision.kind.value,
    )


def _lane_change(scene: Scene, road: Road) -> str:
    """Return the side and the finished share of the lane change in progress; "" without one."""
    if scene.lane_change is None:
        return ""
    origin_m, target_m = map(road.center_m, scene.lane_change[:2])
    way_m, done_m = target_m - origin_m, float(scene.snapshot.y_m[EGO]) - origin_m
    side = "left" if way_m > 0 else "right"
    return f"changing {side}, {100 * min(max(done_m / way_m, 0.0), 1.0):.0f} %"


class PictureRenderer:
    """The renderer of render mode ``rgb_array``: it draws the present scene in ``render``."""

    def __init__(self, road: Road) -> None:
        self._road = road
        self._moment: tuple[Snapshot, Caption] | None = None

    def reset(self, snapshot: Snapshot, seed: int) -> None:
        """Begin an episode with its first snapshot, the seed of its traffic, and no text yet."""
        self._moment = snapshot, Caption(vehicles=len(snapshot.ids) - 1, seed=seed)

    def step(self, decision: Transition) -> None:
        """Store the scene and update the caption with the decision."""
        assert self._moment is not None
        self._moment = (
            decision.next_scene.snapshot,
            next_caption(self._moment[1], decision, self._road),
        )

    def render(self) -> Picture:
        """Return the picture of the present scene, uint8 of shape (720, 1280, 3).

        Raises:
            gymnasium.error.ResetNeeded: no episode has begun.
        """
        if self._moment is None:
            raise gymnasium.error.ResetNeeded("There is nothing to draw yet: call reset.")
        snapshot, caption = self._moment
        return draw(snapshot, self._road, caption)


class GuiRenderer:
    """The renderer of render mode ``human``: sumo-gui, with a caption and the films' colours.

    ``show`` shows a line of text, and vehicles by id in colours, as ``Simulation.show`` does.
    """

    def __init__(self, show: Callable[[str, Mapping[str, Color]], None]) -> None:
        self._show = show

    def reset(self, snapshot: Snapshot, seed: int) -> None:
        """Clear the text, and show the colours of the vehicles of a new episode."""
        self._show("", vehicle_colors(snapshot))

    def step(self, decision: Transition) -> None:
        """Show the executed action, the safety rule, the speed and the reward as text."""
        speed_m_s = decision.next_scene.affordances.ego_speed_m_s
        made = f"{decision.executed} | rule: {decision.rule} | {speed_m_s:.1f} m/s"
        text = f"{made} | reward {decision.reward:.2f}"
        self._show(text, vehicle_colors(decision.next_scene.snapshot))

    def render(self) -> Picture | None:
        """Return None, as there is no picture besides the window."""
        return None


def renderer_of(
    render_mode: str | None, road: Road, show: Callable[[str, Mapping[str, Color]], None]
) -> PictureRenderer | GuiRenderer | None:
    """Return the renderer of a render mode; ``show`` is the argument of ``GuiRenderer``."""
    if render_mode == "rgb_array":
        return PictureRenderer(road)
    return None if render_mode is None else GuiRenderer(show)


def vehicle_colors(snapshot: Snapshot) -> dict[str, Color]:
    """Return the colour of each vehicle by id; it shows the speed of all vehicles but the ego."""
    colors = map(speed_color, snapshot.speed_m_s.tolist())
    return dict(zip(snapshot.ids, colors, strict=True)) | {snapshot.ids[EGO]: EGO_COLOR}
