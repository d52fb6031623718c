"""People around the ego, the adversary among them, and the crash rate that its weights give."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drl_av.arrays import IntArray
from drl_av.config import Config
from drl_av.driving.car_following import idm_acceleration
from drl_av.safety import named_check
from verification import crash_simulation, crash_table
from verification.adversary import LENGTH_M, BatchStrict, World, one_by_one
from verification.crash_rate import exact_share, rate, report
from verification.crash_simulation import drive, drivers, run, settings
from verification.families import needed_gap, placed
from verification.naturalistic import (
    ADVERSARY,
    HARD_BRAKES_PER_S,
    HIGHD,
    LANE_CHANGES_PER_S,
    PEOPLE,
    Frequencies,
    Traffic,
    _idm,
    _leaders,
    _room,
    starts,
)


def world_of(*others: tuple[float, int, float], ego_m_s: float = 30.0) -> World:
    """The ego in the middle lane; the others' centres ahead of its own, lanes and speeds."""
    x_m, lane, speed = (np.array([column]) for column in zip(*others, strict=True))
    return placed(np.array([1]), np.array([ego_m_s]), x_m.astype(float), lane, speed.astype(float))


@given(
    speed=st.floats(0, 40),
    desired=st.floats(1, 45),
    gap=st.floats(0.0, 300.0),
    closing=st.floats(-20, 20),
)
def test_people_follow_the_intelligent_driver_model(
    speed: float, desired: float, gap: float, closing: float
) -> None:
    ours = _idm(np.array([speed]), desired, np.array([gap]), np.array([closing]))
    assert ours[0] == pytest.approx(idm_acceleration(speed, desired, gap, closing, HIGHD))


def test_an_act_that_the_adversary_makes_five_times_as_often_counts_a_fifth() -> None:
    traffic = Traffic(world_of((40.0, 1, 30.0)), ADVERSARY, np.random.default_rng(3))
    certain, never = np.array([[1.0]]), np.array([[1e-12]])
    assert traffic._happens(certain * 0.999999, 0.2).all()
    assert traffic.weights[0] == pytest.approx(0.2, rel=1e-5)
    assert not traffic._happens(never, 0.1).any()
    # it did not happen, which among people has the probability 0.9
    assert traffic.weights[0] == pytest.approx(0.2 * 0.9, rel=1e-5)
    # an event that cannot count changes no weight
    traffic._happens(np.array([[0.5]]), 0.1, np.array([[False]]))
    assert traffic.weights[0] == pytest.approx(0.2 * 0.9, rel=1e-5)


def test_without_an_adversary_every_weight_is_1_and_with_it_their_mean_is() -> None:
    for frequencies, tolerance in ((PEOPLE, 0.0), (ADVERSARY, 0.05)):
        rng = np.random.default_rng(5)
        world = starts(4_000, Config(), rng)
        traffic = Traffic(world, frequencies, rng)
        for _ in range(10):
            traffic.decide(world, np.zeros(4_000, np.int64))
        assert traffic.weights.mean() == pytest.approx(1.0, abs=tolerance + 1e-9)
    assert traffic.weights.min() < 0.2


def test_a_vehicle_that_changes_lanes_leads_in_both() -> None:
    # the second is between the right lane and the middle one, which it moves into
    world = world_of((50.0, 1, 30.0), (20.0, 0, 30.0), (-30.0, 0, 30.0))
    world.y_m[0, 2] = 1.0
    gap_m, leader = _leaders(world, np.array([[1, 1, 0]]))
    assert leader[0].tolist() == [2, -1, 1, 2]
    # bumper to bumper: 20 - 5 from the ego, 30 - 5 from the second to the first, 50 - 5 behind
    assert gap_m[0].tolist() == [15.0, np.inf, 25.0, 45.0]


@pytest.mark.parametrize(
    ("ahead_m", "speed", "room", "careful"),
    [
        (4.0, 30.0, False, False),  # beside the ego
        (8.0, 30.0, True, False),  # 3 m ahead: the ego would have to brake hard
        (40.0, 30.0, True, True),
        (-8.0, 36.0, False, True),  # 3 m behind and 6 m/s faster: its driver would brake hard
        (-60.0, 30.0, True, True),
    ],
)
def test_room_and_care_before_a_lane_change(
    ahead_m: float, speed: float, room: bool, careful: bool
) -> None:
    world = world_of((ahead_m, 2, speed))
    can, is_careful = _room(world, np.array([[2]]), np.array([[1]]))
    assert can[0, 0] == room
    if room:
        assert is_careful[0, 0] == careful


def test_a_careful_change_begins_and_continues_to_the_centre_of_the_lane() -> None:
    often = Frequencies(1e-9, 1 - 1e-9, 1e-9)
    world = world_of((20.0, 2, 30.0), ego_m_s=20.0)
    traffic = Traffic(world, often, np.random.default_rng(0))
    sides = []
    for y_m in (7.6, 6.4, 5.2, 3.8):
        world.y_m[0, 1] = y_m
        sides.append(traffic.decide(world, np.array([0])).side[0, 0])
    assert all(side < 0 for side in sides[:3])
    assert sides[3] == 0.0


def test_more_careless_people_need_no_more_weight() -> None:
    # half of them are careless by themselves, as often as the adversary makes them
    often = Frequencies(HARD_BRAKES_PER_S, LANE_CHANGES_PER_S, 0.5)
    rng = np.random.default_rng(2)
    traffic = Traffic(starts(2_000, Config(), rng), often, rng, careless=0.5)
    traffic.decide(starts(2_000, Config(), np.random.default_rng(2)), np.zeros(2_000, np.int64))
    assert (traffic.weights == 1.0).all()


def test_the_start_leaves_the_ego_the_gap_that_its_check_requires() -> None:
    config = settings("real")
    world = starts(2_000, config, np.random.default_rng(1))
    ego_lane = np.round(world.y_m[:, 0] / 3.8).astype(int)
    rows = np.arange(2_000)
    lead = 1 + 3 * ego_lane
    gap_m = world.x_m[rows, lead] - world.x_m[:, 0] - LENGTH_M
    needed_m = needed_gap(world.speed_m_s[:, 0], world.speed_m_s[rows, lead], config)
    assert (gap_m >= needed_m - 1e-9).all()
    # the long ranges behind the first vehicle of a lane are those of the studies: a lognormal with
    # the median 34 m, of which 10 % are above 70.6 m; the short ones are widened: 38.3 m /
    # sqrt(1 - (30 / 31)^4 + 3 / 1.46) = 25.9 m at 30 m/s, where 10 % would be below 16.4 m
    ranges_m = (world.x_m[:, 2::3] - world.x_m[:, 1::3] - LENGTH_M).ravel()
    assert np.percentile(ranges_m, [10, 90]) == pytest.approx([22.2, 70.6], rel=0.06)


def test_no_start_makes_a_driver_brake_hard_at_once() -> None:
    world = starts(2_000, settings("strict"), np.random.default_rng(7))
    target = np.round(world.y_m[:, 1:] / 3.8).astype(int)
    gap_m, leader = _leaders(world, target)
    speed = world.speed_m_s[:, 1:]
    ahead = np.take_along_axis(world.speed_m_s, np.maximum(leader, 0), 1)[:, 1:]
    braking = -_idm(speed, speed + 1.0, gap_m[:, 1:], speed - ahead)[leader[:, 1:] >= 0]
    assert braking.max() == pytest.approx(3.0)
    # some of them brake at first, as people do who have just come near
    assert 0.2 < (braking > 2.9).mean() < 0.4


def test_the_rate_is_the_weighted_share_of_crashes() -> None:
    # one crash of weight 0.1 in four tests: 0.025; deviation 0.05, half-width 1.96 * 0.05 / 2;
    # crashes that no test has seen: 3 / 4 * 1.2
    found = rate(np.array([0.0, 1.0, 0.0, 0.0]), np.array([1.2, 0.1, 0.9, 1.0]))
    assert found.value == pytest.approx(0.025)
    assert (found.lower, found.upper) == (0.0, pytest.approx(0.025 + 0.049 + 0.9))
    # no crash in 300 tests whose largest weight is 2: at most 3 / 300 * 2
    none = rate(np.zeros(300), np.full(300, 2.0))
    assert none == (0.0, 0.0, pytest.approx(0.02))


def test_without_weights_the_interval_is_exact() -> None:
    # Clopper and Pearson for 2 of 1000: 0.000242 to 0.007206; for 0 of 1000 up to 1 - 0.025^0.001
    two, plain = np.array([1.0, 1.0] + [0.0] * 998), np.ones(1000)
    assert rate(two, plain) == pytest.approx((0.002, 0.000242, 0.007206), rel=2e-3)
    assert rate(np.zeros(1000), plain) == (0.0, 0.0, pytest.approx(0.0036821, rel=1e-4))
    assert exact_share(3, 3).upper == 1.0


def test_a_check_that_permits_something_else_than_it_executes_has_an_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def stair(world: World, proposed: IntArray) -> IntArray:
        """Accelerate becomes maintain, that becomes braking, that hard braking, always permitted.

        In the second scene nothing is permitted.
        """
        executed = np.array([2, 0, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3])[proposed]
        executed[1] = (proposed[1] + 1) % 12
        return executed

    monkeypatch.setattr(crash_simulation, "check_of", lambda config: stair)
    found = run(settings("paper"), 2, PEOPLE, 11, driver="idm-mobil")
    assert found.unanswered[0] == 0
    assert found.unanswered[1] > 0


def test_a_driver_trained_at_scale_answers_for_all_scenes_at_once_as_for_each_alone() -> None:
    config, ways = settings("strict"), []
    for check in (BatchStrict(config), one_by_one(named_check(config))):
        rng = np.random.default_rng(5)
        world, egos = starts(12, config, rng), drivers("pretrained", config, 12)
        ways.append(drive(config, world, Traffic(world, ADVERSARY, rng), check, egos).km)
    assert ways[0].tolist() == ways[1].tolist()
    assert len(set(ways[0])) > 6


def test_tests_are_reproducible_and_their_starts_are_the_same_for_every_check(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(crash_simulation, "BATCH", 4)
    first = run(settings("strict"), 6, ADVERSARY, 11)
    again = run(settings("strict"), 6, ADVERSARY, 11, jobs=2)
    assert all(np.array_equal(one, two) for one, two in zip(first, again, strict=True))
    assert len(first.weights) == 6
    # 27 seconds at no more than 30 m/s
    assert (first.km > 0.4).all()
    assert (first.km <= 0.8101).all()
    assert "6 tests" in report("strict", first)


def test_the_table_of_the_documentation_is_what_the_program_prints() -> None:
    hit, none, one = np.array([1.0, 0.0]), np.zeros(2), np.ones(2)
    found = crash_simulation.Outcome(one, hit, none, 0.5 * one, none)
    printed = f"1 % of the lane changes are careless\n{report('paper', found)}\n"
    real = report("real", found._replace(ego_hit=none))
    printed += f"50 % of the lane changes are careless\n{real}"
    # one of two: Clopper and Pearson; twice that a km
    assert crash_table.table(printed).splitlines()[2:] == [
        "| 1 % | paper | 5.00e-01 (1.26e-02 to 9.87e-01) | 1.00e+00 (2.52e-02 to 1.97e+00) "
        "| 5.00e-01 (1.26e-02 to 9.87e-01) | 1 |",
        "| 50 % | strict, bounds of real traffic | 0.00e+00 (0.00e+00 to 8.42e-01) "
        "| 0.00e+00 (0.00e+00 to 1.68e+00) | 0.00e+00 (0.00e+00 to 8.42e-01) | 1 |",
    ]
