"""The bounds that ``strict`` puts on the others: the types keep to them, and the auditor sees.

Bounds worked with: braking 4 m/s^2, acceleration 2 m/s^2, sideways 0.76 m/s; a follower brakes at
4 m/s^2 after 0.5 s; the ego stops 0.5 m short of a vehicle that cuts in. A SUMO step takes 0.5 s.
"""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from worlds import CENTER, LEFT, ROAD, Car, ahead, behind, snapshot

from drl_av.config import Config
from drl_av.drivers.rule_based import RandomDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.road_types import ROAD_TYPES
from verification.auditor import (
    ACCELERATED,
    BEHIND,
    BESIDE,
    BETWEEN,
    BRAKED,
    BRAKES,
    CUT_IN,
    LEAVES,
    SIDEWAYS,
    SOONER,
    THROUGH,
    TOO_FAST,
    Auditor,
    Breach,
)

CONFIG = Config()
STEP_S = 0.5


# The auditor, on snapshots half a second apart


def moved(
    *others: tuple[Car, Car], ego_m_s: tuple[float, float] = (20.0, 20.0), y_m: float = CENTER
) -> list[Breach]:
    """What the auditor says of vehicles before and after a SUMO step; both relative to the ego."""
    moments = zip(ego_m_s, zip(*others, strict=True), strict=True)
    return told(*(snapshot(*cars, speed_m_s=v, y_m=y_m) for v, cars in moments)).breaches


def told(*shots: Snapshot, config: Config = CONFIG, road: Road = ROAD) -> Auditor:
    """An auditor that has watched these snapshots, half a second apart."""
    auditor = Auditor(config, road)
    for step, shot in enumerate(shots):
        auditor.watch(shot._replace(time_s=step * STEP_S))
    return auditor


def moves_in(car: Car) -> tuple[Car, Car]:
    """A vehicle before and after the step in which it begins to move to the right."""
    return car, car._replace(y_m=car.y_m - 0.38, lateral_speed_m_s=-0.76)


def names(breaches: list[Breach]) -> list[str]:
    return [breach.bound for breach in breaches]


@pytest.mark.parametrize(
    ("speed_m_s", "bound"),
    [
        (18.0, []),  # 2 m/s less in half a second are 4 m/s^2
        (17.99, [BRAKED]),
        (21.0, []),
        (21.01, [ACCELERATED]),
    ],
)
def test_braking_and_acceleration_are_reported_by_the_change_of_speed(
    speed_m_s: float, bound: list[str]
) -> None:
    assert names(moved((ahead(100.0), ahead(100.0, speed_m_s=speed_m_s)))) == bound


@pytest.mark.parametrize("sign", [1, -1])
def test_0_38_m_sideways_in_a_step_is_as_fast_as_permitted(sign: int) -> None:
    lane = CENTER - sign * 3.8
    before = ahead(100.0, lane)
    for off_m, bound in ((0.38, []), (0.381, [SIDEWAYS])):
        after = ahead(100.0, lane + sign * off_m, v_y=sign * off_m / STEP_S)
        assert names(moved((before, after))) == bound


def test_a_breach_names_time_vehicle_and_bound() -> None:
    calm, hasty = (ahead(50.0), ahead(50.0)), (ahead(100.0), ahead(100.0, speed_m_s=15.0))
    assert moved(calm, hasty) == [Breach(0.5, "vehicle2", BRAKED)]


def test_the_ego_is_bound_by_nothing_here() -> None:
    assert moved((behind(100.0), behind(100.0)), ego_m_s=(20.0, 10.0)) == []


def test_who_begins_to_cut_in_leaves_the_ego_room_to_stop() -> None:
    for ego_m_s, gap, bound in (
        # the ego at 20 m/s goes on for a second, 20 m, and rolls 45 m braking; the other one at
        # 10 m/s rolls 10 m: 65 - 10 + 0.5
        (20.0, 55.51, []),
        (20.0, 55.49, [CUT_IN]),
        # it accelerates from 19 to 20 m/s in this step, so 21 and 22 m/s in the next:
        # 10.5 + 11 + 55 - 10 + 0.5
        (19.0, 67.01, []),
        (19.0, 66.99, [CUT_IN]),
    ):
        assert names(moved(moves_in(ahead(gap, LEFT, 10.0)), ego_m_s=(ego_m_s, 20.0))) == bound


@pytest.mark.parametrize("offset_m", [-4.9, 0.0, 4.9])
def test_a_vehicle_that_begins_to_move_in_beside_the_ego_is_reported(offset_m: float) -> None:
    assert names(moved(moves_in(Car(offset_m, LEFT)))) == [BESIDE]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        # to the other side
        (Car(0.0, LEFT), Car(0.0, LEFT + 0.38, 20.0, 0.76)),
        # it has begun earlier, which was judged then
        (Car(0.0, LEFT - 0.38, 20.0, -0.76), Car(0.0, LEFT - 0.76, 20.0, -0.76)),
        # it is over the line already
        (Car(0.0, LEFT - 1.5, 20.0, 0.0), Car(0.0, LEFT - 1.88, 20.0, -0.76)),
        # it comes back to its own lane
        (Car(0.0, LEFT + 0.38, 20.0, -0.76), Car(0.0, LEFT, 20.0, 0.0)),
        # it wavers about the centre of its lane
        (Car(0.0, LEFT), Car(0.0, LEFT - 0.04, 20.0, -0.08)),
        # it moves in behind
        moves_in(behind(10.0, LEFT)),
    ],
)
def test_other_moves_sideways_are_no_cut_in(before: Car, after: Car) -> None:
    assert moved((before, after)) == []


def test_who_creeps_stands_still_until_it_is_faster_or_over_the_line() -> None:
    creeps = Car(0.0, LEFT - 0.3, 20.0, -0.009)
    assert names(moved((creeps, Car(0.0, LEFT - 0.68, 20.0, -0.76)))) == [BESIDE]
    assert moved((creeps, Car(0.0, LEFT - 0.304, 20.0, -0.008))) == []
    # its right side is over the line at 5.7 m by a centimetre at 6.59 m
    near = Car(0.0, 6.593, 20.0, -0.008)
    assert moved((near, Car(0.0, 6.591, 20.0, -0.004))) == []
    assert names(moved((near, Car(0.0, 6.589, 20.0, -0.008)))) == [BESIDE]


def test_who_is_ahead_in_a_lane_of_the_ego_s_may_move_into_the_other() -> None:
    # the ego's left side is at 6.22 m, over the line at 5.7 m
    starts = moves_in(ahead(20.0, LEFT, 10.0))
    assert moved(starts, y_m=5.32) == []
    assert names(moved(starts)) == [CUT_IN]


LATE = behind(26.0, speed_m_s=30.0), behind(21.0, speed_m_s=30.0)
"""It has to hit the ego, and does not brake."""


@pytest.mark.parametrize(
    ("vehicle", "ego_m_s", "circumstance"),
    [
        (moves_in(ahead(66.0, LEFT, 10.0)), 19.0, SOONER),
        (moves_in(ahead(40.0, LEFT, 10.0)), 20.0, ""),
        (moves_in(Car(0.0, LEFT - 0.8)), 20.0, BETWEEN),
        (moves_in(Car(0.0, LEFT)), 20.0, ""),
        # its right side, 0.9 m from its middle, is over the line at 5.7 m
        ((behind(26.0, 6.03, 30.0, 0.76), behind(21.0, 6.22, 30.0, 0.76)), 20.0, LEAVES),
        ((behind(26.0, 6.03, 30.0, 0.76), behind(21.0, 5.84, 30.0, 0.76)), 20.0, ""),
        (LATE, 20.0, ""),
        (LATE, 22.0, BRAKES),
    ],
)
def test_a_breach_says_whether_the_ego_brakes_and_whether_the_bound_was_kept_a_step_sooner(
    vehicle: tuple[Car, Car], ego_m_s: float, circumstance: str
) -> None:
    [breach] = moved(vehicle, ego_m_s=(ego_m_s, 20.0))
    assert breach.circumstance == circumstance


def test_one_behind_in_a_lane_that_the_ego_leaves_in_that_step_is_free() -> None:
    # the ego's left side, 0.9 m from its middle, is over the line at 5.7 m, and then is not
    for ends, bound in (((5.7, 5.32), [BEHIND]), ((4.94, 4.56), [])):
        shots = (snapshot(behind(20.0, LEFT, 30.0), y_m=y_m) for y_m in ends)
        assert names(told(*shots).breaches) == bound


def test_a_cut_in_ahead_of_another_vehicle_is_no_cut_in_ahead_of_the_ego() -> None:
    between = (ahead(10.0), ahead(10.0))
    starts = moves_in(ahead(20.0, LEFT, 10.0))
    assert names(moved(starts)) == [CUT_IN]
    assert moved(between, starts) == []


def test_a_cut_in_is_seen_the_long_way_round_a_small_loop() -> None:
    # 45 m behind is, on a loop of 100 m, 55 m ahead: 50 m of gap where 55.5 m are needed
    small = Road(100.0, 3.8, (True, True, True))
    starts = moves_in(Car(-45.0, LEFT, 10.0))
    shots = (snapshot(car, s_m=70.0, road=small) for car in starts)
    assert names(told(*shots, road=small).breaches) == [CUT_IN]


@pytest.mark.parametrize(
    ("first_m", "breaches", "circumstance"),
    [
        # its second step, from 3.6 to 3.98 m, takes it past the centre at 3.8 m
        (3.22, [[], [], [CUT_IN], [CUT_IN]], BETWEEN),
        # it is at 3.8 m after two steps
        (3.04, [[], [], [], [CUT_IN]], THROUGH),
    ],
)
def test_a_vehicle_that_passes_a_lane_s_centre_without_stopping_begins_a_new_movement(
    first_m: float, breaches: list[list[str]], circumstance: str
) -> None:
    # through the middle lane, 30 m ahead of the ego in the left one
    places_m = (first_m + 0.38 * step for step in range(4))
    shots = [snapshot(ahead(30.0, y_m, 10.0, 0.76), y_m=LEFT) for y_m in places_m]
    found = [told(*shots[:number]).breaches for number in range(1, 5)]
    assert [names(each) for each in found] == breaches
    assert found[-1][0].circumstance == circumstance


def test_who_moves_in_behind_the_ego_has_to_be_able_to_stop_there() -> None:
    # at 30 m/s it rolls 105 m, the ego at 20 m/s 45 m
    for gap, bound in ((60.01, []), (59.99, [TOO_FAST])):
        assert names(moved(moves_in(behind(gap, LEFT, 30.0)))) == bound
    between = (behind(10.0), behind(10.0))
    assert moved(between, moves_in(behind(50.0, LEFT, 30.0))) == []


def test_a_lane_that_the_ego_leaves_in_that_very_step_is_open_to_others() -> None:
    # the ego's left side, 0.9 m from its middle, is over the line at 5.7 m, and then is not
    for before_m, after_m, bound in ((5.32, 4.94, [BESIDE]), (4.94, 4.56, [])):
        before, after = Car(0.0, 11.4), Car(0.0, 11.02)
        auditor = told(snapshot(before, y_m=before_m), snapshot(after, y_m=after_m))
        assert names(auditor.breaches) == bound


def test_a_follower_that_has_to_hit_the_ego_and_does_not_brake_is_reported() -> None:
    # 21 m behind at 30 m/s, which rolls 105 m; the ego at 20 m/s rolls 45 m
    assert names(moved(LATE)) == [BEHIND]
    brakes = (behind(26.0, speed_m_s=32.0), behind(21.0, speed_m_s=30.0))
    assert moved(brakes) == []
    # from 60 m on it may still come to rest behind the ego
    for gap, bound in ((60.01, []), (59.99, [BEHIND])):
        assert names(moved((behind(gap, speed_m_s=30.0), behind(gap, speed_m_s=30.0)))) == bound
    beside = (behind(26.0, LEFT, 30.0), behind(21.0, LEFT, 30.0))
    assert moved(beside) == []


def test_one_behind_in_a_lane_that_the_ego_has_just_entered_may_take_half_a_second() -> None:
    # at 4.56 m the left side is at 5.46 m; at 5.32 m it is over the line, at 5.7 m
    places_m = (4.56, 4.94, 5.32, 5.7)
    shots = [snapshot(behind(20.0, LEFT, 30.0), y_m=y_m, v_y=0.76) for y_m in places_m]
    assert told(*shots[:3]).breaches == []
    assert names(told(*shots).breaches) == [BEHIND]


def test_an_explanation_counts_what_that_vehicle_did_since_then_and_a_start_forgets() -> None:
    speeds_m_s = (20.0, 15.0, 15.0, 20.0)
    auditor = told(*(snapshot(ahead(50.0), ahead(100.0, speed_m_s=v)) for v in speeds_m_s))
    assert auditor.explain("vehicle2", 0.0) == f"{ACCELERATED}; {BRAKED}"
    assert auditor.explain("vehicle2", 1.0) == ACCELERATED
    assert auditor.explain("vehicle1", 0.0) == ""
    auditor.start()
    assert auditor.explain("vehicle2", 0.0) == ""


# The traffic

MIXES = {
    "sumo": {},
    "finite-state": {"finite_state_share": 1.0},
    "level-0": {"level_0_share": 1.0},
    "level-1": {"level_1_share": 1.0},
    "mixed": {"finite_state_share": 0.25, "level_0_share": 0.25, "level_1_share": 0.25},
    "eager": {"speed_gain_max": 5.0, "random_lane_changes_per_s": 0.01},
}


@pytest.fixture(params=MIXES)
def watched(request: pytest.FixtureRequest) -> Iterator[tuple[HighwayEnv, list[Snapshot]]]:
    """An environment, and the snapshots of its every SUMO step."""
    config = CONFIG.with_traffic("calm").updated("traffic", **MIXES[request.param])
    config = config.updated("simulation", decisions_per_episode=60)
    env, shots = HighwayEnv(config=config, safety_check="strict"), []
    env.simulation.after_step = shots.append
    yield env, shots
    env.close()


def test_no_mix_of_drivers_brakes_accelerates_or_moves_sideways_beyond_the_bounds(
    watched: tuple[HighwayEnv, list[Snapshot]],
) -> None:
    env, shots = watched
    auditor = Auditor(env.config, env.road)
    for seed, vehicles in ((860_000, 30), (860_001, 12)):
        drive(env, RandomDriver(), "random", seed, vehicles)
        auditor.start()
        for shot in shots:
            auditor.watch(shot)
        assert len(shots) >= 2 * env.decisions - 1
        shots.clear()
        assert not {BRAKED, ACCELERATED, SIDEWAYS} & set(names(auditor.breaches))


def test_late_braking_is_named_where_vehicles_ahead_may_brake_harder() -> None:
    # 112 m to stop from 30 m/s with 4 m/s^2, and the ego 12 m from 10 m/s; with 9 m/s^2 50 m
    for braking_m_s2 in (4.0, 9.0):
        config, gaps_m = CONFIG.updated("strict", braking_m_s2=braking_m_s2), (75, 68, 61, 54)
        shots = (snapshot(behind(gap_m, speed_m_s=30.0), speed_m_s=10.0) for gap_m in gaps_m)
        assert BEHIND in names(told(*shots, config=config).breaches)


def test_vehicles_that_enter_and_leave_an_open_road_confuse_no_one() -> None:
    fast, slow = ahead(60.0, LEFT, 30.0), ahead(90.0, speed_m_s=5.0)
    before = snapshot(fast, slow)._replace(ids=("ego", "fast", "slow"))
    # "fast" has left; in its row is now "slow", and behind that one "new" has entered
    after = snapshot(slow, behind(90.0, LEFT, 12.0))._replace(ids=("ego", "slow", "new"))
    assert told(before, after).breaches == []
    # and it still sees what the one does that is in both
    braked = snapshot(ahead(90.0, speed_m_s=1.0), behind(90.0, LEFT, 12.0))
    shots = before, after, braked._replace(ids=after.ids)
    assert told(*shots).breaches == [Breach(1.0, "slow", BRAKED)]


def test_the_traffic_of_a_ramp_keeps_the_bounds(tmp_path: Path) -> None:
    write_scenario(tmp_path / "road", ROAD_TYPES["merge"]())
    config = CONFIG.updated("simulation", scenario=str(tmp_path / "road"))
    with closing(HighwayEnv(config=config)) as env:
        auditor = Auditor(env.config, env.road)
        env.simulation.after_step = auditor.watch
        env.reset(seed=1)
        vehicles = {*env.scene.snapshot.ids}
        for _ in range(25):
            env.step(0)
        assert {*env.scene.snapshot.ids} - vehicles  # some have entered
        assert not {BRAKED, ACCELERATED} & {*names(auditor.breaches)}
