"""Counts of driving style over decisions that are made by hand."""

import runpy
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from worlds import Car, ahead, behind, scene

from drl_av.driving.actions import ACTIONS
from drl_av.driving.scene import LaneChange
from drl_av.env.decision import Decision

TOOL = Path(__file__).parents[1] / "tools" / "measure_style.py"


@pytest.fixture(scope="module")
def style_class() -> Any:
    return runpy.run_path(str(TOOL))["Style"]


def decision(
    before_m_s: float,
    after_m_s: float,
    *cars: Car,
    later: tuple[Car, ...] | None = None,
    lane_change: LaneChange | None = None,
) -> Decision:
    first = scene(*cars, speed_m_s=before_m_s, lane_change=lane_change)
    second = scene(*(cars if later is None else later), speed_m_s=after_m_s)
    return Decision(first, None, ACTIONS[0], 0.0, second, None, False, False, {})


def test_maintaining_between_does_not_hide_a_reversal(style_class: Any) -> None:
    style = style_class()
    speeds = [20.0, 22.0, 22.1, 20.1, 18.1, 18.1, 20.1, 22.1]
    for before, after in pairwise(speeds):
        style.add(decision(before, after))
    assert style.reversals == 2  # up, a trifle, down, down, none, up, up
    assert style.driven_km == pytest.approx(sum(speeds[1:]) / 1000)
    style.begin()
    style.add(decision(20.0, 18.0))  # the first of another episode
    assert style.reversals == 2


def test_a_short_headway_is_below_a_second_at_the_speed_afterwards(style_class: Any) -> None:
    style = style_class()
    style.add(decision(20.0, 22.0, ahead(21.9)))
    style.add(decision(22.0, 20.0, ahead(20.1)))
    style.add(decision(4.0, 4.0, ahead(2.0)))  # a queue that crawls
    assert style.short_headways == 1


def test_only_a_lane_change_forces_the_vehicle_behind_to_brake(style_class: Any) -> None:
    cars, braked, mild = (
        (behind(9.0, speed_m_s=20.0),),
        (behind(9.0, speed_m_s=17.5),),
        (behind(9.0, speed_m_s=18.1),),
    )
    style, change = style_class(), LaneChange(0, 1)
    style.add(decision(20.0, 20.0, *cars, later=braked))
    style.add(decision(20.0, 20.0, *cars, later=mild, lane_change=change))
    assert style.forced_brakes == 0
    style.add(decision(20.0, 20.0, *cars, later=braked, lane_change=change))
    assert style.forced_brakes == 1
