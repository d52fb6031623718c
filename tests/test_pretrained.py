"""The shipped driver: what it was trained with, and that it drives."""

from dataclasses import asdict

import numpy as np

from drl_av.config import Config, load_config
from drl_av.driving.drivers.rules import IdmDriver
from drl_av.env import HighwayEnv
from drl_av.episode import drive
from drl_av.studies.drivers import PRETRAINED, learned_driver


def test_it_learnt_from_what_happened_alone_and_in_a_mirror_among_the_default_traffic() -> None:
    _, config = learned_driver(PRETRAINED)
    learning = config.learning
    assert config == load_config(PRETRAINED / "config.toml")
    assert config.updated("learning", **asdict(Config().learning)) == Config()
    assert (learning.episodes, learning.mirrored, learning.counterfactuals) == (2000, True, 0)


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
