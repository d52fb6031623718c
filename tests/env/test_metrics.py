"""Every column of the results tables, by episodes worked out by hand."""

import itertools
import math
from collections.abc import Iterable
from dataclasses import asdict, fields
from typing import Any

import pytest
from decisions import decided
from worlds import CENTER, LEFT, RIGHT, ahead, behind, changing, scene

from drl_av.driving.scene import LaneChange, Scene
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.env.transition import Transition
from drl_av.road.snapshot import Collision, CollisionKind
from drl_av.safety.check import Rule

KEEP, BRAKE, HARD_BRAKE, TO_RIGHT, TO_RIGHT_HARD, TO_LEFT, TO_LEFT_HARD = 0, 2, 3, 4, 7, 8, 11
"""Numbers of actions; right and left at an unchanged speed, or braking hard."""
FREE = scene()


def decision(
    before: Scene = FREE,
    after: Scene = FREE,
    executed: int = KEEP,
    *,
    rule: str = "none",
    way: str = "",
    **fields: Any,
) -> Transition:
    given: dict[str, Any] = {"reward": -0.2, "terms": (-0.3, -0.3, 0.0)} | fields
    named = Rule.NONE
    for word in rule.upper().split("+"):
        named |= Rule[word]
    return decided(before, after, executed, rule=named, route_outcome=way, **given)


def row(*decisions: Transition) -> EpisodeResult:
    metrics = EpisodeMetrics()
    for each in decisions:
        metrics.add(each)
    return metrics.result("idm", "paper", 7, 42)


def through(*scenes: Scene, actions: Iterable[int]) -> EpisodeResult:
    """The row of an episode that shows these scenes, the first one after the reset."""
    steps = zip(itertools.pairwise(scenes), actions, strict=True)
    return row(*(decision(before, after, action) for (before, after), action in steps))


def test_a_row_of_three_decisions_worked_out_by_hand() -> None:
    # 20 m/s behind a vehicle of 15 m/s; a lane change to the left is begun, then aborted
    start = scene(ahead(30, speed_m_s=15))
    first = scene(
        ahead(24, speed_m_s=15), y_m=CENTER + 0.76, v_y=0.76, lane_change=LaneChange(1, 2)
    )
    second = scene(ahead(20, speed_m_s=15), speed_m_s=18.0)
    third = scene(ahead(21, speed_m_s=15), speed_m_s=14.0)
    done = row(
        decision(start, first, TO_LEFT, reward=-0.5, terms=(-0.1, -0.9, -0.5)),
        decision(first, second, TO_RIGHT, reward=-0.25, terms=(-0.4, 0.0, -0.35)),
        decision(
            *(second, third, HARD_BRAKE),
            proposed=KEEP,
            rule="in_lane",
            reward=-0.3,
            terms=(-0.7, -0.2, 0.0),
        ),
    )
    # in the order of the published tables
    assert [*asdict(done).items()] == [
        *(("driver", "idm"), ("safety_check", "paper"), ("vehicles", 7), ("seed", 42)),
        *(("decisions", 3), ("mean_speed_m_s", pytest.approx((20 + 18 + 14) / 3))),
        *(("mean_reward", pytest.approx(-0.35)), ("mean_r_v", pytest.approx(-0.4))),
        *(("mean_r_y", pytest.approx(-1.1 / 3)), ("mean_r_x", pytest.approx(-0.85 / 3))),
        *(("collided", False), ("ego_hit", False), ("collision", "")),
        *(("safety_triggers", 1), ("lane_changes", 0), ("aborted_lane_changes", 1)),
        ("min_ttc_s", pytest.approx(24 / 5)),  # then 20 / 3, then none: the gap opens
        ("min_headway_s", pytest.approx(20 / 18)),  # 24 / 20 before, 21 / 14 after
        *(("hard_brakes", 1), ("d_safe_violations", 2)),
        *(("way", ""), ("world", "sumo"), ("group", "")),
    ]


def test_the_way_is_a_column_only_where_the_ego_has_one() -> None:
    names = [field.name for field in fields(EpisodeResult)][:-2]  # without world and group
    loop = row(decision(), decision())
    assert [*loop.cells()] == names[:-1]
    assert not loop.missed
    found = {}
    for outcome in ("exit taken", "exit missed", "merged", "not merged"):
        done = row(decision(), decision(way=outcome))
        assert [*done.cells()] == names
        found[done.cells()["way"]] = done.missed
    assert found == {"exit taken": False, "exit missed": True, "merged": False, "not merged": True}


def test_the_reset_counts_nowhere() -> None:
    # a vehicle 2 m ahead that closes, at 30 m/s: gone after the first decision
    hectic = scene(ahead(2, speed_m_s=10), speed_m_s=30.0)
    done = row(decision(hectic, scene(speed_m_s=26.0)))
    assert (done.decisions, done.mean_speed_m_s) == (1, 26.0)
    assert (done.min_ttc_s, done.min_headway_s) == (math.inf, math.inf)


@pytest.mark.parametrize("rule", ["in_lane", "off_road", "lane_change", "in_lane+lane_change"])
def test_every_rule_of_the_check_is_a_trigger_once(rule: str) -> None:
    done = row(decision(rule=rule), decision(), decision(rule=rule))
    assert done.safety_triggers == 2


def test_a_proposal_that_was_changed_counts_as_it_was_executed() -> None:
    done = row(
        decision(executed=HARD_BRAKE, proposed=KEEP, rule="in_lane"),
        decision(executed=BRAKE, proposed=HARD_BRAKE, rule="in_lane"),
        decision(executed=TO_LEFT_HARD),
        decision(executed=TO_RIGHT_HARD),
    )
    assert done.hard_brakes == 3


def test_an_abort_is_the_opposite_direction_executed_during_a_lane_change() -> None:
    to_left, to_right = changing(origin=1, target=2, seconds=2), LaneChange(1, 0)
    assert row(decision(to_left, executed=TO_RIGHT)).aborted_lane_changes == 1
    assert row(decision(to_left, executed=TO_LEFT)).aborted_lane_changes == 0
    assert row(decision(to_left, executed=KEEP)).aborted_lane_changes == 0
    right = scene(y_m=CENTER - 0.76, v_y=-0.76, lane_change=to_right)
    assert row(decision(right, executed=TO_LEFT)).aborted_lane_changes == 1
    assert row(decision(right, executed=TO_RIGHT)).aborted_lane_changes == 0
    assert row(decision(FREE, executed=TO_RIGHT)).aborted_lane_changes == 0  # it begins one
    # proposed and not executed it is none
    kept = decision(to_left, executed=KEEP, proposed=TO_RIGHT, rule="lane_change")
    assert row(kept).aborted_lane_changes == 0
    made = decision(to_left, executed=TO_RIGHT, proposed=KEEP, rule="lane_change")
    assert row(made).aborted_lane_changes == 1


def test_a_lane_change_counts_once_and_only_when_it_has_ended() -> None:
    ways = [changing(origin=1, target=2, seconds=seconds) for seconds in range(1, 5)]
    there, on = scene(y_m=LEFT), scene(y_m=LEFT)
    done = through(FREE, *ways, there, on, actions=[TO_LEFT, *[KEEP] * 5])
    assert (done.lane_changes, done.aborted_lane_changes) == (1, 0)
    done = through(FREE, *ways, actions=[TO_LEFT, *[KEEP] * 3])
    assert done.lane_changes == 0  # its centre is over the line, but it is still on its way


def test_an_aborted_lane_change_is_no_lane_change_though_it_was_past_the_line() -> None:
    over_line = changing(origin=1, target=2, seconds=3)
    back = scene(y_m=CENTER + 1.52, v_y=-0.76, lane_change=LaneChange(2, 1))
    home = scene(y_m=CENTER)
    done = through(FREE, over_line, back, home, actions=[TO_LEFT, TO_RIGHT, KEEP])
    assert (done.lane_changes, done.aborted_lane_changes) == (0, 1)


def test_there_and_back_again_are_two_lane_changes() -> None:
    to_right = scene(y_m=RIGHT + 0.76, v_y=-0.76, lane_change=LaneChange(1, 0))
    to_center = scene(y_m=CENTER - 0.76, v_y=0.76, lane_change=LaneChange(0, 1))
    scenes = (FREE, to_right, scene(y_m=RIGHT), to_center, FREE)
    done = through(*scenes, actions=[TO_RIGHT, KEEP, TO_LEFT, KEEP])
    assert (done.lane_changes, done.aborted_lane_changes) == (2, 0)


def test_time_to_collision_and_headway_read_the_vehicle_ahead_in_the_own_lane() -> None:
    decoys = [behind(1, speed_m_s=30), ahead(1, LEFT, 5), ahead(1, RIGHT, 5)]
    done = row(decision(after=scene(*decoys, ahead(40, speed_m_s=12), speed_m_s=20.0)))
    assert (done.min_ttc_s, done.min_headway_s) == (40 / 8, 40 / 20)
    nothing = row(decision(after=scene(*decoys)))
    assert (nothing.min_ttc_s, nothing.min_headway_s) == (math.inf, math.inf)


def test_an_ego_that_stands_has_no_time_headway() -> None:
    done = row(decision(after=scene(ahead(3, speed_m_s=0), speed_m_s=0.0)))
    assert (done.min_ttc_s, done.min_headway_s) == (math.inf, math.inf)


@pytest.mark.parametrize(
    ("kind", "ego_hit"),
    [
        *((CollisionKind.HIT_AHEAD, True), (CollisionKind.HIT_BESIDE, True)),
        (CollisionKind.HIT_EDGE, True),
        *((CollisionKind.HIT_FROM_BEHIND, False), (CollisionKind.HIT_FROM_BESIDE, False)),
    ],
)
def test_a_collision_says_who_hit_whom(kind: CollisionKind, ego_hit: bool) -> None:
    done = row(decision(), decision(reward=-3.0, collision=Collision(kind, "vehicle3")))
    assert (done.collided, done.ego_hit, done.collision) == (True, ego_hit, kind.value)
    assert done.mean_reward == -1.6  # the collision's reward is in the mean


def test_d_safe_is_violated_where_r_x_is_below_0() -> None:
    near, at_it = (0.0, 0.0, -1e-9), (-0.9, -0.9, 0.0)
    done = row(decision(terms=near), decision(terms=at_it), decision(terms=near))
    assert done.d_safe_violations == 2
