"""Level 0 drives by a table of nine cases, levels 1 and 2 by a network each."""

from pathlib import Path

import numpy as np
import pytest
from worlds import CENTER, LEFT, RIGHT, ROAD, Car, ahead, behind, seen_from, snapshot

from drl_av.config import Config
from drl_av.drivers.background.level_k import (
    LEVELS,
    LevelKNumbers,
    layer,
    level_0,
    level_k,
    level_k_numbers,
    load_level_k,
)
from drl_av.drivers.network import Layers, QNetwork, forward
from drl_av.drivers.policy_file import save_policy
from drl_av.driving.actions import ACTIONS, acceleration_of
from drl_av.driving.affordances import compute_indicators
from drl_av.driving.observation_scale import ObservationScale
from drl_av.errors import CheckpointError
from drl_av.road.snapshot import Snapshot

CONFIG = Config()
ACCELERATE, MAINTAIN, BRAKE, HARD_BRAKE = 2.0, 0.0, -2.0, -4.0


def decisions(driver: LevelKNumbers, shot: Snapshot) -> tuple[list[float], list[int]]:
    """The accelerations and the lane changes that each vehicle wants as a level-1 driver."""
    wanted = []
    for row in range(len(shot.ids)):
        values, codes, *_ = compute_indicators(seen_from(shot, row), ROAD, 250.0)
        units = np.empty((2, driver.units), np.float32)
        wanted.append(level_k(values, codes, ROAD.lane_width_m, driver, units))
    accelerations, sides = zip(*wanted, strict=True)
    return list(accelerations), list(sides)


def wanted_by_ego(*others: Car) -> float:
    values, codes, *_ = compute_indicators(snapshot(*others), ROAD, 250.0)
    return acceleration_of(level_0(values, codes, CONFIG.level_0), CONFIG.ego)


@pytest.mark.parametrize(
    ("gap_m", "speed_m_s", "acceleration_m_s2"),
    [
        (11.0, 19.0, HARD_BRAKE),  # close and approaching, at 20 m/s itself
        (11.0, 19.5, BRAKE),  # close and stable
        (11.0, 20.5, BRAKE),
        (11.0, 21.0, MAINTAIN),  # close and moving away
        (11.5, 19.0, BRAKE),  # nominal and approaching
        (27.0, 19.0, BRAKE),
        (27.0, 19.5, MAINTAIN),  # nominal and stable
        (27.0, 20.5, MAINTAIN),
        (27.0, 21.0, ACCELERATE),  # nominal and moving away
        (27.5, 0.0, ACCELERATE),  # far: ignored, however fast it nears
        (27.5, 20.0, ACCELERATE),
        (0.0, 0.0, HARD_BRAKE),
    ],
)
def test_level_0_drives_by_distance_and_motion_of_the_vehicle_ahead(
    gap_m: float, speed_m_s: float, acceleration_m_s2: float
) -> None:
    assert wanted_by_ego(ahead(gap_m, speed_m_s=speed_m_s)) == acceleration_m_s2


def test_level_0_looks_neither_behind_nor_aside_and_keeps_its_lane() -> None:
    decoys = (behind(3.0, speed_m_s=30.0), ahead(5.0, LEFT, 10.0), ahead(5.0, RIGHT, 10.0))
    assert wanted_by_ego(*decoys) == ACCELERATE
    assert wanted_by_ego(*decoys, ahead(20.0, speed_m_s=18.0)) == BRAKE
    assert wanted_by_ego() == ACCELERATE


def always(number: int) -> Layers:
    """A network that prefers one action everywhere."""
    bias = np.zeros(12, dtype=np.float32)
    bias[number] = 1.0
    return [(np.zeros((12, 27), dtype=np.float32), bias)]


@pytest.mark.parametrize("action", ACTIONS, ids=str)
def test_level_1_wants_what_the_action_of_the_greatest_value_says(action: object) -> None:
    number = ACTIONS.index(action)  # type: ignore[arg-type]
    shot = snapshot(ahead(50.0))
    side = (0, -1, 1)[number // 4]
    acceleration = (MAINTAIN, ACCELERATE, BRAKE, HARD_BRAKE)[number % 4]
    found = decisions(level_k_numbers(always(number), CONFIG, ROAD), shot)
    assert found == ([acceleration, acceleration], [side, side])


@pytest.mark.parametrize(("number", "sides"), [(4, [-1, 0, -1, 0]), (8, [1, 1, 0, 0])])
def test_level_1_changes_neither_off_the_road_nor_while_it_is_changing(
    number: int, sides: list[int]
) -> None:
    shot = snapshot(Car(50.0, RIGHT), Car(100.0, LEFT), Car(150.0, CENTER + 0.76))
    assert decisions(level_k_numbers(always(number), CONFIG, ROAD), shot)[1] == sides


@pytest.mark.parametrize(
    ("others", "side"),
    [
        ((ahead(15.1, LEFT), behind(15.1, LEFT)), 1),  # eq. 3 at equal speeds: more than 15 m
        ((ahead(14.9, LEFT),), 0),
        ((behind(14.9, LEFT),), 0),
        ((ahead(14.9),), 0),
        ((behind(1.0), ahead(1.0, RIGHT), behind(1.0, RIGHT)), 1),  # of no concern
        ((ahead(20.9, LEFT, 18.0),), 0),  # 3 s * 2 m/s more where it closes
        ((ahead(21.1, LEFT, 18.0),), 1),
        ((behind(20.9, LEFT, 22.0),), 0),
        ((behind(21.1, LEFT, 22.0),), 1),
        ((behind(9.1, LEFT, 18.0),), 1),  # and less where it opens
        ((ahead(9.1, LEFT, 22.0),), 1),
        ((behind(8.9, LEFT, 18.0),), 0),
    ],
)
def test_level_1_changes_lanes_where_rule_3_permits_it(others: tuple[Car, ...], side: int) -> None:
    driver = level_k_numbers(always(8), CONFIG, ROAD)
    assert decisions(driver, snapshot(*others))[1][0] == side


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a run with an untrained policy and another top speed than the default."""
    config = CONFIG.updated("learning", hidden_units=16).updated("ego", max_speed_m_s=25.0)
    network = QNetwork(np.random.default_rng(41), hidden=(16, 16))
    save_policy(tmp_path / "policy.safetensors", network, config)
    (tmp_path / "config.toml").write_text(config.to_toml())
    return tmp_path


def test_level_1_decides_as_the_network_of_a_run_sees_it(run: Path) -> None:
    shot = snapshot(*(ahead(17.0 * k, (RIGHT, CENTER, LEFT)[k % 3], 10.0 + k) for k in range(1, 9)))
    layers = QNetwork(np.random.default_rng(41), hidden=(16, 16)).layers
    seen = [compute_indicators(seen_from(shot, row), ROAD, 250.0) for row in range(9)]
    scale = ObservationScale(CONFIG.observation, 25.0, ROAD)
    observations = scale(np.array([each.values[:27] for each in seen]))
    best = np.array([forward(layers, row)[1].argmax() for row in observations])
    assert len(set(best % 4)) > 1
    meant = np.array([MAINTAIN, ACCELERATE, BRAKE, HARD_BRAKE])[best % 4]
    assert decisions(load_level_k(ROAD, 1, run), shot)[0] == meant.tolist()


def test_a_layer_adds_up_the_inputs_in_their_order_compiled_or_not() -> None:
    rng = np.random.default_rng(3)
    weight = rng.normal(size=(27, 100)).astype(np.float32)
    bias, entered = weight[0] + 1, weight[:, 5].copy()
    one_by_one = bias.copy()
    for row, number in zip(weight, entered, strict=True):
        one_by_one = one_by_one + row * number
    for function in (layer, layer.python):
        sums = np.zeros(101, np.float32)
        function(weight, bias, entered, sums)
        assert np.array_equal(sums[:100], one_by_one)
        assert sums[100] == 0.0


@pytest.mark.parametrize("harm", ["missing", "cut short", "27 -> 16"])
def test_level_1_that_cannot_be_read_is_reported_in_one_sentence(run: Path, harm: str) -> None:
    reason = {
        "missing": "holds no trained driver",
        "cut short": "cut short",
        "27 -> 16": "does not fit a network of 27 -> 100",
    }[harm]
    file = run / "policy.safetensors"
    if harm == "missing":
        file.unlink()
    elif harm == "cut short":
        file.write_bytes(file.read_bytes()[:-100])
    else:
        save_policy(file, QNetwork(np.random.default_rng(0), hidden=(16, 16)), CONFIG)
    message = rf"^The level-1 driver of the traffic cannot be read \(.*{reason}.*\): train .*make"
    with pytest.raises(CheckpointError, match=message):
        load_level_k(ROAD, 1, run)


@pytest.mark.parametrize("level", [1, 2])
def test_a_level_ships_with_the_package_and_was_trained_among_the_level_below(level: int) -> None:
    assert load_level_k(ROAD, level).range_m == 250.0
    text = (LEVELS[level] / "config.toml").read_text()
    assert f"\nlevel_{level - 1}_share = 1.0\n" in text
    assert f"\nlevel_{level}_share = 1.0\n" not in text
