"""The shipped driver: what it was trained with, and that it drives."""

from pathlib import Path

import numpy as np
import pytest

from drl_av.config import load_config
from drl_av.config.presets import preset
from drl_av.drivers.background.level_1 import LEVEL_1
from drl_av.drivers.policy_file import PRETRAINED, load_policy
from drl_av.drivers.registry import load_driver
from drl_av.drivers.rules import IdmDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.learning.checkpoint import save_policy


def test_it_learnt_as_the_preset_fast_does_for_longer_and_with_its_eyes_on_speed() -> None:
    _, config = load_driver(PRETRAINED)
    assert config == load_config(PRETRAINED / "config.toml")
    own = {"speed_weight": 0.8, "discount": 0.95, "learning_rate": 1e-3, "lane_change_margin": 0.04}
    assert config == preset("fast").updated("learning", episodes=1000, seed=1, **own)


@pytest.mark.parametrize("folder", [PRETRAINED, LEVEL_1], ids=["driver", "level_1"])
def test_what_ships_is_what_this_version_would_write(folder: Path, tmp_path: Path) -> None:
    networks, config = load_policy(folder / "policy.safetensors")
    assert load_config(folder / "config.toml") == config
    save_policy(tmp_path / "policy.safetensors", networks, config)
    written = (tmp_path / "policy.safetensors").read_bytes()
    assert (folder / "policy.safetensors").read_bytes() == written


def test_it_overtakes_the_rule_based_driver_on_the_same_traffic_without_hitting_anything() -> None:
    driver, config = load_driver(PRETRAINED)
    env = HighwayEnv(config=config)
    seeds = range(700_000, 700_008)
    learned = [drive(env, driver, "pretrained", seed, 10) for seed in seeds]
    ruled = [drive(env, IdmDriver(config.safety), "idm", seed, 10) for seed in seeds]
    env.close()
    assert not any(result.ego_hit for result in learned)
    speeds = [np.mean([row.mean_speed_m_s for row in rows]) for rows in (learned, ruled)]
    assert speeds[0] > speeds[1] + 0.5
