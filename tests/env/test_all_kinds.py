"""Traffic of all kinds: each episode draws one kind, and is the same as in that kind alone."""

from contextlib import closing

import numpy as np
import pytest

from drl_av.config import SINGLE_PRESETS, Config, TrafficConfig, from_toml
from drl_av.env.highway import HighwayEnv
from drl_av.env.scene_values import Observation
from drl_av.env.vector import TwinVectorEnv
from drl_av.errors import ConfigError
from drl_av.road.snapshot import Snapshot
from drl_av.safety import assumptions

ALL = Config().with_traffic("all")
SEEDS = range(800_000, 800_020)


def kind_of(env: HighwayEnv) -> str:
    simulations = [simulation for simulation, _ in env._setups]
    return SINGLE_PRESETS[simulations.index(env.simulation)]


def driven(env: HighwayEnv, seed: int) -> list[Observation]:
    observation, _ = env.reset(seed=seed, options={"vehicles": 8})
    return [observation, *(env.step(0)[0] for _ in range(5))]


def test_an_episode_is_one_of_the_kind_that_its_seed_draws() -> None:
    env, found = HighwayEnv(config=ALL), dict[str, tuple[int, list[Observation]]]()
    for seed in SEEDS:
        episode = driven(env, seed)
        found.setdefault(kind_of(env), (seed, episode))
    assert set(found) == set(SINGLE_PRESETS)
    for kind, (seed, episode) in found.items():
        with HighwayEnv(config=Config().with_traffic(kind)) as alone:
            assert np.array_equal(driven(alone, seed), episode)
    seed, episode = found["naturalistic"]
    assert np.array_equal(driven(env, seed), episode)  # whatever was driven before
    env.close()


def test_what_watches_the_steps_watches_those_of_the_next_kind() -> None:
    with HighwayEnv(config=ALL) as env:
        shots: list[Snapshot] = []
        env.simulation.after_step = shots.append
        before = kind_of(env)
        kinds = set()
        for seed in SEEDS[:6]:
            shots.clear()
            driven(env, seed)
            kinds.add(kind_of(env))
            assert len(shots) == 10
        assert kinds - {before}


def test_strict_is_refused_if_one_kind_breaks_its_assumptions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    strict = ALL.updated("safety", check="strict")
    HighwayEnv(config=strict)
    monkeypatch.setattr(assumptions, "RANDOM_LANE_CHANGES_PER_S", 0.005)  # hazards has 0.01
    for make in (HighwayEnv, TwinVectorEnv):
        with pytest.raises(ConfigError, match=r"at most 0\.005, and not 0\.01"):
            make(config=strict)


def test_on_an_open_road_an_episode_has_the_vehicles_of_its_kind_in_the_twin_too() -> None:
    ramp = Config().updated("simulation", scenario="merge")
    ramp = ramp.updated("traffic", presets=["calm", "naturalistic"])
    seeds, twin = range(1_000_000, 1_000_004), ramp.updated("simulation", world="twin")
    found = [TwinVectorEnv(4, config=ramp).reset(seed=[*seeds])[1]["vehicles"].tolist()]
    for config in (ramp, twin):
        with closing(HighwayEnv(config=config)) as env:
            found.append([env.reset(seed=seed)[1]["vehicles"] for seed in seeds])
            found.append([env.fleet_of(seed).default_vehicle_count for seed in seeds])
    assert found == [[65, 65, 38, 38]] * 5


def test_all_kinds_take_the_settings_beside_them() -> None:
    late = Config().updated("traffic", presets=SINGLE_PRESETS, keep_stopping_distance=False)
    assert {each.traffic.keep_stopping_distance for each in late.per_traffic_preset} == {False}


def test_each_episode_draws_one_of_the_kinds_that_are_listed() -> None:
    two = Config().updated("traffic", presets=["hazards", "calm"], vehicles_max=3)
    kinds = [each.traffic for each in two.per_traffic_preset]
    assert [kind.standing_share for kind in kinds] == [0.01, 0.0]
    assert {kind.vehicles_max for kind in kinds} == {3}
    assert Config().per_traffic_preset == [Config()]
    assert from_toml(two.to_toml()) == two


def test_unknown_kinds_are_refused() -> None:
    for name, said in (("clam", "did you mean .calm."), ("all", "its kinds of traffic are: calm")):
        with pytest.raises(ConfigError, match=said):
            Config().updated("traffic", presets=(name,))
    with pytest.raises(ConfigError, match=r"traffic\.presets is 'calm', but must be a list"):
        TrafficConfig(presets="calm")  # type: ignore[arg-type]
