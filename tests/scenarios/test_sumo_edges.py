"""The edges that open roads have in SUMO: long ones are divided, and nothing else changes."""

from contextlib import closing
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.env.highway import HighwayEnv
from drl_av.scenarios.folder import load_scenario, write_scenario
from drl_av.scenarios.highways import ExitDescription, MergeDescription, StraightDescription
from drl_av.scenarios.layout import split_long_edges
from drl_av.scenarios.loop import ScenarioDescription
from drl_av.scenarios.open_road import OpenDescription


def test_a_straight_road_of_2800_m_has_seven_edges_of_400_m(tmp_path: Path) -> None:
    write_scenario(tmp_path / "road", StraightDescription())
    layout = load_scenario(tmp_path / "road").layout
    assert layout.routes == {"road": ("road", *(f"road.{number}" for number in range(1, 7)))}
    assert layout.lane_positions["road_0"] == (0, 0.0)
    assert layout.lane_positions["road.1_0"] == (0, 400.0)
    assert layout.lane_positions["road.6_2"] == (2, 2400.0)


def test_a_road_of_2000_m_with_its_run_out_is_one_edge_and_a_loop_has_four() -> None:
    assert len(split_long_edges(StraightDescription(length_m=1200.0).plan()).edges) == 1
    assert len(split_long_edges(StraightDescription(length_m=1201.0).plan()).edges) == 6
    assert len(split_long_edges(ScenarioDescription(9000.0).plan()).edges) == 4


def test_only_the_long_edge_before_an_exit_is_divided() -> None:
    plan = split_long_edges(ExitDescription(approach_m=2500.0).plan())
    ends = {edge.id: (edge.begin_m, edge.end_m) for edge in plan.edges}
    assert ends == {
        "before": (0.0, 364.0),  # a seventh of 2,550 m is 364.3 m
        "before.1": (364.0, 729.0),
        "before.2": (729.0, 1093.0),
        "before.3": (1093.0, 1457.0),
        "before.4": (1457.0, 1821.0),
        "before.5": (1821.0, 2186.0),
        "before.6": (2186.0, 2550.0),
        "exit": (2550.0, 2800.0),
        "after": (2800.0, 3400.0),
        "off_ramp": (2800.0, 3400.0),
    }
    assert plan.routes["exit"][-2:] == ("exit", "off_ramp")


@given(
    st.one_of(
        st.builds(StraightDescription, length_m=st.floats(300.0, 40_000.0)),
        st.builds(MergeDescription, after_m=st.floats(50.0, 40_000.0)),
    )
)
def test_the_pieces_of_every_road_follow_each_other_without_a_gap(
    description: OpenDescription,
) -> None:
    plan, whole = split_long_edges(description.plan()), description.plan()
    edges = {edge.id: edge for edge in plan.edges}
    for name, route in plan.routes.items():
        for one, other in pairwise(route):
            assert edges[one].end_m == edges[other].begin_m
            assert edges[one].end_m - edges[one].begin_m >= 10.0
        assert route[0] == whole.routes[name][0]
    assert all(edge.end_m - edge.begin_m <= 2000.0 for edge in plan.edges)


def test_the_ego_drives_and_changes_lanes_across_the_seams(tmp_path: Path) -> None:
    """Alone and at full throttle it passes a seam each 400 m, the first within a lane change."""
    write_scenario(tmp_path / "road", StraightDescription(flow_per_h=0.0))
    config = Config().updated("simulation", scenario=str(tmp_path / "road"))
    states, over = [], False
    with closing(HighwayEnv(config=config)) as env:
        env.reset(seed=1, options={"vehicles": 0})
        first_lane = env.scene.affordances.lane
        side = Lateral.LEFT if first_lane < 2 else Lateral.RIGHT
        while not over:
            lateral = side if 340.0 < env.scene.snapshot.s_m[0] < 400.0 else Lateral.KEEP
            *_, terminated, over, _ = env.step(Action(lateral, Longitudinal.ACCELERATE).number)
            assert not terminated
            shot = env.scene.snapshot
            states.append((shot.s_m[0], shot.y_m[0], shot.speed_m_s[0]))
    for (s_m, y_m, speed), (next_s_m, next_y_m, next_speed) in pairwise(states):
        assert next_s_m - s_m == pytest.approx((speed + next_speed) / 2, abs=0.51)
        assert abs(next_y_m - y_m) <= 0.76 + 1e-6  # 3.8 m in 5 s
    across_m = next(y_m for s_m, y_m, _ in states if s_m > 400.0)
    assert 0.7 < (across_m - first_lane * 3.8) * side.sign < 3.7
    assert states[-1][1] == pytest.approx((first_lane + side.sign) * 3.8)
    assert states[-1][0] >= 2300.0
