"""The learned driver decides by value: in a mirror, by a mean, and above a margin."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import (
    ALONE,
    CENTER,
    EXIT,
    LANE_M,
    LEAVE,
    LEFT,
    MERGE,
    RIGHT,
    Car,
    ahead,
    behind,
    changing,
    scene,
)

from drl_av.config import Config, MobilConfig
from drl_av.drivers.learned import (
    LearnedDriver,
    Values,
    learned_driver,
    mean_values,
    mirrored_values,
    network_values,
    respects_mobil,
)
from drl_av.drivers.network import QNetwork
from drl_av.driving.actions import ACTIONS, Action, Lateral
from drl_av.driving.mirror import MIRROR, Mirror, mirrored_observations
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.road.road import Road
from drl_av.safety.check import Rule, Verdict, permit_all

MAINTAIN, ACCELERATE, BRAKE = 0, 1, 2
MAINTAIN_RIGHT, ACCELERATE_LEFT = 4, 9
S_T: Any = np.zeros(27, np.float32)
UNDER_WAY = changing(origin=1, target=2, seconds=1)


def stated(values: dict[int, float]) -> Values:
    """The values that a story gives, -1 for what it does not name."""
    return lambda s_t: np.array([values.get(number, -1.0) for number in range(12)], np.float32)


def decided(values: dict[int, float], margin: float, scene: Scene = ALONE) -> int:
    return LearnedDriver(stated(values), margin).act(scene, S_T).number


@pytest.mark.parametrize(
    ("left", "margin", "expected"),
    [
        (0.53, 0.0, ACCELERATE_LEFT),  # the paper's: any difference will do
        (0.53, 0.02, ACCELERATE_LEFT),  # 0.51 is still more than 0.5
        (0.51, 0.02, ACCELERATE),  # 0.49 is not
        (0.53, 0.04, ACCELERATE),
    ],
)
def test_a_lane_change_begins_only_where_it_gains_more_than_the_margin(
    left, margin, expected
) -> None:
    values = {MAINTAIN: 0.3, ACCELERATE: 0.5, MAINTAIN_RIGHT: 0.2, ACCELERATE_LEFT: left}
    assert decided(values, margin) == expected


def test_a_lane_change_that_has_begun_goes_on_or_back_by_value_alone() -> None:
    back, on = {ACCELERATE: 0.5, MAINTAIN_RIGHT: 0.501}, {ACCELERATE: 0.5, ACCELERATE_LEFT: 0.501}
    assert decided(back, 0.2, UNDER_WAY) == MAINTAIN_RIGHT
    assert decided(on, 0.2, UNDER_WAY) == ACCELERATE_LEFT
    assert decided(back, 0.2) == decided(on, 0.2) == ACCELERATE


@pytest.mark.parametrize(
    ("refused", "expected"),
    [
        ((), ACCELERATE_LEFT),
        ((ACCELERATE_LEFT,), ACCELERATE),
        ((ACCELERATE_LEFT, ACCELERATE), MAINTAIN),  # not 9's neighbour 8, which is worth less
        (tuple(range(12)), ACCELERATE_LEFT),  # the check replaces it
    ],
)
def test_a_driver_with_a_check_takes_the_best_action_that_it_permits(refused, expected) -> None:
    def check(scene: Scene, proposed: Action) -> Verdict:
        if proposed.number in refused:
            return Verdict(ACTIONS[(proposed.number + 1) % 12], Rule.IN_LANE)
        return Verdict(proposed, Rule.NONE)

    values = {MAINTAIN: 0.3, ACCELERATE: 0.5, ACCELERATE_LEFT: 0.9}
    driver = LearnedDriver(stated(values)).limited_to(respects_mobil(check, MobilConfig()))
    assert driver.act(ALONE, S_T).number == expected


def considerate_act(values: dict[int, float], world: Scene) -> int:
    driver = LearnedDriver(stated(values)).limited_to(respects_mobil(permit_all, MobilConfig()))
    return driver.act(world, S_T).number


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (behind(16.2, LEFT), ACCELERATE_LEFT),
        (behind(15.9, LEFT), ACCELERATE),
        (behind(15.9, RIGHT), ACCELERATE_LEFT),  # it is not in the lane that the ego enters
        (behind(15.9, CENTER), ACCELERATE_LEFT),
        (ahead(5.0, LEFT), ACCELERATE_LEFT),  # that is for the check to forbid
        (behind(63.9, LEFT, speed_m_s=28.0), ACCELERATE),
        (behind(64.4, LEFT, speed_m_s=28.0), ACCELERATE_LEFT),
    ],
)
def test_a_considerate_driver_begins_no_lane_change_that_forces_a_vehicle_to_brake(
    other: Car, expected: int
) -> None:
    # IDM with 1.1 s, 2.5 m, 1.5 and 2 m/s^2 wants 2.5 + 20 * 1.1 = 24.5 m at 20 m/s. It brakes
    # with 1.5 ((24.5 / gap)^2 - 1) = 2 m/s^2 at 16.04 m. At 28 m/s, 8 m/s faster than the ego, it
    # wants 2.5 + 30.8 + 28 * 8 / (2 sqrt 3) = 97.96 m, and the limit is at 64.13 m.
    values = {MAINTAIN: 0.3, ACCELERATE: 0.5, ACCELERATE_LEFT: 0.9}
    assert considerate_act(values, scene(other)) == expected


@pytest.mark.parametrize(
    ("road", "lane", "lanes", "expected"),
    [
        (LEAVE, 2, -2, ACCELERATE),  # its exit is two lanes to the right
        (EXIT, 2, 0, ACCELERATE_LEFT),  # the off-ramp is not its way
        (MERGE, 0, 1, ACCELERATE_LEFT),  # its lane ends, and the highway is to the left
    ],
)
def test_a_considerate_driver_begins_no_lane_change_away_from_its_way(
    road: Road, lane: int, lanes: int, expected: int
) -> None:
    world = scene(road=road, s_m=600.0, y_m=lane * LANE_M)
    assert world.affordances.mandatory.lanes == lanes
    values = {MAINTAIN: 0.3, ACCELERATE: 0.5, ACCELERATE_LEFT: 0.9}
    assert considerate_act(values, world) == expected


@pytest.mark.parametrize(("s_m", "expected"), [(647.0, MAINTAIN), (648.0, MAINTAIN_RIGHT)])
def test_a_considerate_driver_forces_its_way_where_less_than_250_m_are_left_for_each_lane_change(
    s_m: float, expected: int
) -> None:
    # 2 lane changes by 1,150 m; the front bumper has 500.5 m left at 647 m, and 499.5 m at 648 m
    world = scene(behind(5.0, LANE_M), road=LEAVE, s_m=s_m, y_m=2 * LANE_M)
    assert considerate_act({MAINTAIN: 0.3, MAINTAIN_RIGHT: 0.9}, world) == expected


def test_a_lane_change_that_has_begun_goes_on_before_any_vehicle() -> None:
    world = changing(behind(5.0, LEFT), origin=1, target=2, seconds=1)
    assert considerate_act({MAINTAIN: 0.3, ACCELERATE_LEFT: 0.9}, world) == ACCELERATE_LEFT


def test_the_margin_counts_before_the_permission() -> None:
    values = stated({ACCELERATE: 0.5, ACCELERATE_LEFT: 0.9})
    for margin, expected in ((0.3, ACCELERATE_LEFT), (0.5, ACCELERATE)):
        driver = LearnedDriver(values, margin).limited_to(lambda scene, action: True)
        assert driver.act(ALONE, S_T).number == expected


@given(
    values=st.lists(st.floats(-4, 1, width=32), min_size=12, max_size=12),
    margin=st.floats(0.001, 3),
)
def test_the_margin_decides_between_lanes_and_never_between_speeds(values, margin) -> None:
    number = decided(dict(enumerate(values)), margin)
    lateral = ACTIONS[number].lateral
    alike = [a for a, action in enumerate(ACTIONS) if action.lateral is lateral]
    keeping = max(values[:4])
    # float32 rounds the margin away from values that differ by less than a millionth
    assert values[number] == pytest.approx(max(values[a] for a in alike), abs=1e-6)
    if lateral is Lateral.KEEP:
        assert max(values[4:]) - keeping < margin + 1e-5
    else:
        assert values[number] == pytest.approx(max(values[4:]), abs=1e-6)
        assert values[number] - keeping > margin - 1e-5


def test_algorithm_1_meets_lane_changes_that_the_margin_keeps_its_driver_from() -> None:
    driver = LearnedDriver(stated({ACCELERATE: 0.5, ACCELERATE_LEFT: 0.51}), 0.02)
    assert driver.greedy(S_T) == ACCELERATE_LEFT
    assert driver.act(ALONE, S_T).number == ACCELERATE


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_observation_of_another_length_is_refused_with_the_remedy(mirrored: bool) -> None:
    networks = [QNetwork(np.random.default_rng(0), observation_size=27)]
    driver = learned_driver(networks, Config().updated("learning", mirrored=mirrored))
    with pytest.raises(ConfigError, match=r"has 30 numbers, but this driver observes 27: .*way"):
        driver.act(ALONE, np.zeros(30, np.float32))


def test_the_driver_follows_parameters_that_change_in_place() -> None:
    network, other = (QNetwork(np.random.default_rng(seed)) for seed in (0, 1))
    values = network_values(network)
    assert not np.array_equal(values(S_T), network_values(other)(S_T))
    network.flat[:] = other.flat
    assert np.array_equal(values(S_T), network_values(other)(S_T))


def test_of_equal_values_the_first_is_taken() -> None:
    assert LearnedDriver(stated({ACCELERATE: 0.5, ACCELERATE_LEFT: 0.5})).greedy(S_T) == ACCELERATE


# Three indicators: gap right, gap left, own y from the middle of the road; two actions swap.
TINY_MIRROR = Mirror(
    observation_permutation=np.array([1, 0, 2]),
    observation_sign=np.array([1, 1, -1], np.float32),
    action_permutation=np.array([0, 2, 1]),
)


def test_in_a_mirror_the_values_are_the_mean_of_both_sides() -> None:
    plain = network_values(QNetwork(np.random.default_rng(3), 3, 3, hidden=(4,)))
    s = np.array([0.3, 0.7, -1.0], np.float32)
    here, there = plain(s), plain(np.array([0.7, 0.3, 1.0], np.float32))
    expected = [(here[0] + there[0]) / 2, (here[1] + there[2]) / 2, (here[2] + there[1]) / 2]
    assert np.allclose(mirrored_values(plain, TINY_MIRROR)(s), expected)
    assert not np.allclose(plain(s), expected)


@given(seed=st.integers(0, 10_000))
def test_it_changes_left_where_in_the_mirror_it_changes_right(seed: int) -> None:
    rng = np.random.default_rng(seed)
    driver = LearnedDriver(mirrored_values(network_values(QNetwork(rng))))
    s = rng.standard_normal(27).astype(np.float32)
    reflected = driver.greedy(mirrored_observations(s))
    assert reflected == MIRROR.action_permutation[driver.greedy(s)]


def tiny(*parameters: float) -> Values:
    """One input, one hidden unit in one layer, two actions."""
    network = QNetwork(np.random.default_rng(0), 1, 2, (1,))
    network.flat[:] = parameters
    return network_values(network)


def test_two_that_disagree_decide_by_the_mean_of_their_values() -> None:
    # s = 3: z = 2 * 3 + 1 = 7, Q = (7 + 1, -7 + 2) = (8, -5)
    one = tiny(2.0, 1.0, 1.0, -1.0, 1.0, 2.0)
    # s = 3: z = -4 * 3 + 2 = -10 -> -0.1, Q = (10 * -0.1, 20 * -0.1 + 5) = (-1, 3)
    other = tiny(-4.0, 2.0, 10.0, 20.0, 0.0, 5.0)
    both, s_t = mean_values([one, other]), np.array([3.0], np.float32)
    for _ in range(2):  # the first answer changes nothing
        assert both(s_t) == pytest.approx([3.5, -1.0], abs=1e-6)
    assert [values(s_t).argmax() for values in (one, other, both)] == [0, 1, 0]


def test_the_settings_of_the_training_say_whether_it_decides_in_a_mirror() -> None:
    networks = [QNetwork(np.random.default_rng(seed)) for seed in (1, 2)]
    s = np.random.default_rng(0).standard_normal(27).astype(np.float32)
    plain, mirrored = (
        learned_driver(networks, Config().updated("learning", networks=2, mirrored=on)).values(s)
        for on in (False, True)
    )
    members = [network_values(network) for network in networks]
    assert np.array_equal(plain, mean_values(members)(s))
    assert np.array_equal(mirrored, mean_values([mirrored_values(each) for each in members])(s))
    assert not np.allclose(plain, mirrored)
