"""The shipped driver: what it was trained with, and that it drives."""

import numpy as np

from drl_av.config import load_config
from drl_av.driving.drivers.rules import IdmDriver
from drl_av.env import HighwayEnv
from drl_av.episode import drive
from drl_av.presets import preset
from drl_av.studies.drivers import PRETRAINED, learned_driver


def test_it_is_what_the_preset_fast_trains_in_5000_episodes_at_half_the_rate() -> None:
    _, config = learned_driver(PRETRAINED)
    longer = {"episodes": 5000, "learning_rate": 1e-3, "learning_rate_end_fraction": 0.01}
    longer |= {"safe_capacity": 1_000_000, "evaluate_every": 250}
    expected = preset("fast").updated("learning", **longer)
    assert config == load_config(PRETRAINED / "config.toml") == expected


def test_it_overtakes_the_rule_based_driver_on_the_same_traffic_without_hitting_anything() -> None:
    driver, config = learned_driver(PRETRAINED)
    env = HighwayEnv(config=config)
    seeds = range(700_000, 700_008)
    learned = [drive(env, driver, "pretrained", seed, 10) for seed in seeds]
    ruled = [drive(env, IdmDriver(config.safety), "idm", seed, 10) for seed in seeds]
    env.close()
    assert not any(result.ego_hit for result in learned)
    speeds = [np.mean([row.mean_speed_m_s for row in rows]) for rows in (learned, ruled)]
    assert speeds[0] > speeds[1] + 0.5
