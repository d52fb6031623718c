"""The numbers of the paper and of our choices beside it, stated as numbers."""

import pytest

from drl_av.config import Config
from drl_av.config.presets import preset

PAPER = {
    "Table I": {
        "learning.discount": 0.9,  # gamma
        "simulation.decision_interval_s": 1.0,  # sampling time
        "ego.lane_change_duration_s": 5.0,  # T_LC
        "safety.minimum_ttc_s": 3.0,  # T_min
        "safety.hard_brake_ttc_s": 2.0,  # T_HB
        "safety.brake_ttc_s": 3.0,  # T_B
        "safety.accelerate_ttc_s": 8.0,  # T_A
        "safety.minimum_gap_m": 15.0,  # d_TVmin
    },
    "Sec. IV-A, accelerations": {
        "ego.accelerate_m_s2": 2.0,  # a_1
        "ego.brake_m_s2": 2.0,  # a_1
        "ego.hard_brake_m_s2": 4.0,  # a_2
    },
    "Sec. IV-B, traffic": {
        "traffic.vehicles_max": 30,  # N_T
        "observation.range_m": 250.0,
    },
    "Sec. IV-C, reward": {
        "reward.desired_speed_m_s": 30.0,  # v_des
        "reward.desired_lateral_m": 3.8,  # y_des
        "reward.safe_headway_s": 1.3,
    },
    "Sec. IV-C, schedule": {
        "learning.episodes": 10_000,  # N_e
        "simulation.decisions_per_episode": 200,  # N_s
        "learning.evaluate_every": 100,
        "learning.epsilon_start": 1.0,
        "learning.epsilon_end": 0.2,
        "learning.epsilon_fraction": 0.7,  # over 7,000 of 10,000 episodes
        "learning.learning_rate": 1e-4,
        "learning.learning_rate_end_fraction": 1.0,  # a fixed rate
        "learning.hidden_units": 100,  # in each of two layers
    },
    "Alg. 1": {
        "learning.replay": "two-buffer",
        "learning.gradient_steps": 1,
        "learning.mirrored": False,
        "learning.collisions_to_start": 0,
    },
    "ours, where the paper is silent": {
        "learning.target_update_episodes": 5,  # N_C
        "reward.collision_reward": -3.0,  # r_col
        "learning.batch_size": 64,
        "learning.collision_fraction": 0.25,
        "learning.safe_capacity": 100_000,
        "learning.collision_capacity": 50_000,
        "simulation.step_length_s": 0.5,
    },
}


def value(config: Config, name: str) -> object:
    section, key = name.split(".")
    return getattr(getattr(config, section), key)


@pytest.mark.parametrize("place", PAPER)
def test_the_preset_paper_has_the_numbers_of_the_paper(place: str) -> None:
    config = preset("paper")
    assert {name: value(config, name) for name in PAPER[place]} == PAPER[place]
    assert config == Config()
