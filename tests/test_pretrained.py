"""The shipped driver: what it was trained with, and that it drives."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from drl_av.config import Config, load_config
from drl_av.config.presets import preset
from drl_av.drivers.background.level_k import LEVELS
from drl_av.drivers.learned import load_actor
from drl_av.drivers.policy_file import SHIPPED, find_policy, load, load_policy, save_policy
from drl_av.drivers.registry import default_config, find_drivers, load_driver, make_drivers
from drl_av.drivers.rule_based import IdmDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.evaluation.provenance import checksum, read_provenance
from verification.ramps import drive as drive_ramp

RAMPS = ("merge", "exit", "ramp_to_ramp")
ACTORS = ("pretrained", *(f"pretrained-{kind}" for kind in RAMPS))


@pytest.mark.parametrize("name", ACTORS)
def test_they_were_trained_by_the_preset_large_of_their_road(name: str) -> None:
    config = load_actor(SHIPPED[name] / "policy.safetensors")[1]
    large = preset(name.replace("pretrained", "large"))
    assert config == load_config(SHIPPED[name] / "config.toml") == large


def test_the_driver_of_the_paper_was_trained_by_the_whole_schedule_of_the_paper() -> None:
    folder = SHIPPED["pretrained-paper"]
    calm = Config().with_traffic("calm").updated("traffic", keep_stopping_distance=False)
    assert load_config(folder / "config.toml") == calm
    results = Path(__file__).parents[1] / "docs" / "results"
    made_by = read_provenance(results / "whole_schedule.csv")
    assert checksum(find_policy(folder)) == made_by["policies_sha256"]["paper-0"]  # Fig. 6


@pytest.mark.parametrize("kind", RAMPS)
def test_on_ramps_they_reach_the_end_of_their_way_without_hitting_anything(kind: str) -> None:
    config = preset(f"paper-{kind}")
    driver = load_driver(f"pretrained-{kind}")
    with closing(HighwayEnv(config=config)) as env:
        trips = [drive_ramp(env, driver, seed) for seed in range(700_000, 700_006)]
    assert not any(trip.ego_hit for trip in trips)
    assert sum(trip.success for trip in trips) >= 5


Q_NETWORKS = {name: folder for name, folder in SHIPPED.items() if name not in ACTORS}
Q_NETWORKS |= {folder.name: folder for folder in LEVELS.values()}


@pytest.mark.parametrize("folder", Q_NETWORKS.values(), ids=Q_NETWORKS)
def test_a_shipped_policy_has_the_settings_beside_it_and_comes_through_being_written_again(
    folder: Path, tmp_path: Path
) -> None:
    shipped, again = folder / "policy.safetensors", tmp_path / "policy.safetensors"
    network, config = load_policy(shipped)
    assert config == load_config(folder / "config.toml")
    save_policy(again, network, config)
    assert load_policy(again)[1] == config
    [tensors, written] = ({k: v.tobytes() for k, v in load(f)[0].items()} for f in (shipped, again))
    assert tensors == written


@pytest.mark.parametrize("name", ["pretrained", "pretrained-paper"])
def test_on_the_loop_they_are_faster_than_the_paper_s_rule_in_the_same_traffic_and_hit_nothing(
    name: str,
) -> None:
    specs = find_drivers([name])
    config = default_config(specs)
    [driver] = make_drivers(specs, config).values()
    env = HighwayEnv(config=config)
    seeds = range(700_000, 700_008)
    learned = [drive(env, driver, name, seed, 10) for seed in seeds]
    ruled = [drive(env, IdmDriver(config.safety), "idm", seed, 10) for seed in seeds]
    env.close()
    assert not any(result.ego_hit for result in learned)
    speeds = [np.mean([row.mean_speed_m_s for row in rows]) for rows in (learned, ruled)]
    assert speeds[0] > speeds[1] + 0.5
