"""The renderers: captions, pictures, the line in sumo-gui, and no work without a render mode."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from decisions import decided
from worlds import ROAD, ahead, scene, snapshot

from drl_av.drawing.panels import Caption
from drl_av.drawing.picture import draw
from drl_av.driving.scene import LaneChange
from drl_av.env import renderer
from drl_av.env.highway import HighwayEnv
from drl_av.env.renderer import GuiRenderer, PictureRenderer, next_caption
from drl_av.road.snapshot import Collision, CollisionKind
from drl_av.safety.check import Rule

SEED = 42
CARS = [ahead(30.0 * number) for number in range(1, 8)]
KEPT = decided(after=scene(*CARS, speed_m_s=22.0), executed=1, terms=(-0.5, 0.0, -0.1), reward=-0.2)
REFUSED = decided(
    after=scene(*CARS, speed_m_s=18.0),
    executed=3,
    proposed=8,
    rule=Rule.IN_LANE | Rule.LANE_CHANGE,
    collision=Collision(CollisionKind.HIT_AHEAD, "vehicle1"),
    terms=(-0.5, 0.0, -0.1),
    reward=-3.0,
)


def test_the_caption_follows_the_decisions() -> None:
    first = next_caption(Caption(driver="mine", seed=SEED), KEPT, ROAD)
    assert first == Caption(
        driver="mine",
        vehicles=7,
        seed=42,
        decision=1,
        proposed="accelerate, keep lane",
        executed="accelerate, keep lane",
        rule=None,
        reward=-0.2,
        r_v=-0.5,
        r_y=0.0,
        r_x=-0.1,
        speed_history=(22.0,),
        trigger_history=(False,),
    )
    second = next_caption(first, REFUSED, ROAD)
    assert (second.decision, second.reward, second.driver) == (2, -3.0, "mine")
    assert (second.proposed, second.executed) == ("maintain, change left", "hard brake, keep lane")
    assert (second.rule, second.collision) == ("in_lane+lane_change", "ego hit the vehicle ahead")
    assert second.speed_history == (22.0, 18.0)
    assert second.trigger_history == (False, True)


def test_the_caption_says_how_far_a_lane_change_is() -> None:
    there = decided(after=scene(y_m=3.8 + 0.95, lane_change=LaneChange(1, 2)))
    caption = next_caption(Caption(), there, ROAD)
    assert caption.lane_change == "changing left, 25 %"
    back = decided(after=scene(y_m=3.8 + 0.95, lane_change=LaneChange(2, 1)))
    assert next_caption(caption, back, ROAD).lane_change == "changing right, 75 %"
    assert next_caption(caption, KEPT, ROAD).lane_change == ""


def test_a_picture_shows_the_last_moment_with_the_caption_since_the_reset() -> None:
    shown, before = PictureRenderer(ROAD), snapshot(ahead(30))
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        shown.render()
    shown.reset(before, SEED)
    assert np.array_equal(shown.render(), draw(before, ROAD, Caption(vehicles=1, seed=42)))
    shown.step(KEPT)
    caption = next_caption(Caption(seed=42), KEPT, ROAD)
    assert np.array_equal(shown.render(), draw(KEPT.next_scene.snapshot, ROAD, caption))
    shown.reset(before, SEED)
    assert np.array_equal(shown.render(), draw(before, ROAD, Caption(vehicles=1, seed=42)))


def test_sumo_gui_gets_a_line_and_the_colours_of_each_scene() -> None:
    calls: list[tuple[str, Any]] = []
    shown = GuiRenderer(lambda text, colors: calls.append((text, colors)))
    slow_and_fast = snapshot(ahead(30, speed_m_s=10.0), ahead(60, speed_m_s=34.0))
    shown.reset(slow_and_fast, SEED)
    shown.step(REFUSED._replace(next_scene=scene(speed_m_s=18.0)))
    red, blue, magenta = (222, 53, 48), (66, 146, 240), (233, 64, 200)
    line = "hard brake, keep lane | rule: in_lane+lane_change | 18.0 m/s | reward -3.00"
    first = {"ego": magenta, "vehicle1": red, "vehicle2": blue}
    assert calls == [("", first), (line, {"ego": magenta})]
    assert shown.render() is None


def test_no_caption_and_no_picture_is_made_where_nothing_is_rendered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[str] = []

    def noted(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            made.append(name)
            return function(*arguments)

        return call

    monkeypatch.setattr(renderer, "next_caption", noted("caption", next_caption))
    monkeypatch.setattr(renderer, "draw", noted("picture", draw))
    for render_mode, expected in ((None, []), ("rgb_array", ["caption", "caption", "picture"])):
        made.clear()
        with HighwayEnv(render_mode=render_mode) as env:
            env.reset(seed=1, options={"vehicles": 2})
            env.step(0)
            env.step(0)
            env.render()
        assert made == expected
