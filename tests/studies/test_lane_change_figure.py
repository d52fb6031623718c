"""The figure of a lane change and an abort is driven, not drawn by hand."""

import numpy as np
import pytest

from drl_av.config import Config, EgoConfig
from drl_av.driving.actions import Lateral
from studies.lane_change_figure import lane_change_figure, track

KEEP, RIGHT, LEFT = Lateral.KEEP, Lateral.RIGHT, Lateral.LEFT
STEERING = EgoConfig(lateral_plant="steering")


def test_the_track_of_the_point_mass_is_a_ramp_of_5_s() -> None:
    there = track(EgoConfig(), 30.0, [LEFT, *[KEEP] * 5])
    assert (there.time_s[-1], len(there.time_s)) == (pytest.approx(6.0), 121)
    assert there.y_m[[0, 50, 100, 120]] == pytest.approx([0, 1.9, 3.8, 3.8])
    assert set(there.lateral_speed_m_s.round(9)) == {0.0, 0.76}


def test_the_steered_track_has_the_curvature_that_the_law_commands() -> None:
    there = track(STEERING, 30.0, [LEFT, *[KEEP] * 5])
    assert there.curvature_per_m[0] == pytest.approx(6 * 3.8 / 150**2)
    assert there.y_m[50] == pytest.approx(1.9, abs=0.02)
    assert (there.y_m[-1], there.lateral_speed_m_s[-1], there.curvature_per_m[-1]) == (3.8, 0, 0)
    # what it commands is what the path does: v_y changes by v^2 kappa a second
    wanted = 30.0**2 * there.curvature_per_m[:80] * 0.05
    assert np.diff(there.lateral_speed_m_s)[:80] == pytest.approx(wanted, abs=1e-3)


def test_the_figure_has_a_lane_change_and_an_abort_on_both_plants() -> None:
    figure = lane_change_figure(Config())
    change, abort = figure.axes[0], figure.axes[1]
    labels = ["kinematic, at any speed", "steering, 15 m/s", "steering, 30 m/s"]
    for axes, end_m in ((change, 3.8), (abort, 0.0)):
        curves = {line.get_label(): line for line in axes.lines}
        assert [curves[label].get_ydata()[-1] for label in labels] == [end_m] * 3
    [legend] = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == labels
    slower = Config().updated("ego", max_speed_m_s=20.0)
    texts = [text.get_text() for text in lane_change_figure(slower).legends[0].get_texts()]
    assert texts[2] == "steering, 20 m/s"
