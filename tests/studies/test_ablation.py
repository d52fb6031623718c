"""The ablation: what a variant changes, and that it goes on where it stopped."""

from pathlib import Path

import pytest

from drl_av.config import SINGLE_PRESETS
from drl_av.errors import DrlAvError
from drl_av.files.table import read_table
from drl_av.learning.large_scale import learner_of, save_actor
from studies import ablation
from studies.ablation import VARIANTS, TwinWorlds, TwoSecondWorlds, settings


def test_each_variant_is_the_preset_but_for_its_choice() -> None:
    preset = settings("large", 3)
    changed = {
        name: [
            section
            for section in ("traffic", "ppo", "safety", "reward", "learning")
            if getattr(settings(name, 3), section) != getattr(preset, section)
        ]
        for name, variant in VARIANTS.items()
        if variant.worlds is VARIANTS["large"].worlds
    }
    assert changed.pop("large") == []
    assert changed.pop("calm") == ["traffic"]
    assert all(sections == ["ppo"] for sections in changed.values())


@pytest.mark.parametrize("worlds", [*dict.fromkeys(v.worlds for v in VARIANTS.values())])
def test_each_variant_is_measured_in_the_traffic_of_the_rule(
    worlds: type[TwinWorlds], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ablation, "EPISODES", 2)
    monkeypatch.setattr(ablation, "COUNTS", (5,))
    (found, hits), (usual, _) = (ablation.speeds("calm", None, w) for w in (worlds, TwinWorlds))
    assert (found == usual).all()
    assert (found.shape, hits) == ((1, 2), 0)


@pytest.mark.parametrize("variant", ["both", "two-seconds"])
def test_a_policy_is_driven_that_sees_what_its_variant_shows(
    tmp_path: Path, variant: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ablation, "EPISODES", 2)
    monkeypatch.setattr(ablation, "COUNTS", (5,))
    config, base = settings(variant, 3).updated("ppo", worlds=10), VARIANTS[variant].worlds
    policy = tmp_path / "untrained.safetensors"
    save_actor(policy, learner_of(config, base(config, 3)), config)
    found, _ = ablation.speeds("paper", policy, base)
    assert found.shape == (1, 2)
    assert (found > 0.0).all()


def test_an_episode_begins_with_its_first_second_twice_and_then_remembers() -> None:
    small = settings("two-seconds", 0).updated("ppo", worlds=5)
    small = small.updated("simulation", decisions_per_episode=3)
    worlds = TwoSecondWorlds(small, 0)
    for _ in range(7):
        before = worlds.observation.copy()
        actions = worlds.permitted.argmax(axis=1)
        worlds.step_async(actions)
        _, _, dones, _ = worlds.step_wait()
        wide, seen = ablation.WIDE_SIZE, worlds.observation
        assert (seen[dones, :wide] == seen[dones, wide : 2 * wide]).all()
        assert (seen[~dones, :wide] == before[~dones, wide : 2 * wide]).all()


def test_it_goes_on_where_it_stopped(
    tmp_path: Path, two_episodes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ablation, "DECISIONS", 16_384)
    ablation.main([*two_episodes, "--variants", "calm"])
    policy = tmp_path / "runs" / "calm-7.safetensors"
    made = policy.stat().st_mtime_ns
    first = read_table(tmp_path / "out.csv")
    assert [row["traffic"] for row in first] == [*SINGLE_PRESETS]
    assert all(-20.0 < float(row["gain_m_s"]) <= 10.0 for row in first)
    ablation.main([*two_episodes, "--variants", "calm"])
    assert policy.stat().st_mtime_ns == made
    assert read_table(tmp_path / "out.csv") == first
    monkeypatch.setattr(ablation, "DECISIONS", 32_768)
    (tmp_path / "out.csv").unlink()
    with pytest.raises(DrlAvError, match=r"calm-7.* was trained with other settings: choose"):
        ablation.main([*two_episodes, "--variants", "calm"])
    assert policy.stat().st_mtime_ns == made
