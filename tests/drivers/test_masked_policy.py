"""The driver of a training at scale: its files, and how it chooses among permitted actions."""

import random
import shutil
import warnings
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import onnxruntime
import pytest
import torch
from runs import Capsys, files_of, replace_in
from worlds import LEFT, ahead, behind, scene

import drl_av
from drl_av.cli import main
from drl_av.cli.seeds import SeedJob, train_seed
from drl_av.config import Config
from drl_av.config.presets import PRESETS
from drl_av.drivers.driver import Driver
from drl_av.drivers.learned import INPUTS, MaskedPolicyDriver, load_actor
from drl_av.drivers.network import forward
from drl_av.drivers.policy_file import load, save
from drl_av.drivers.registry import load_driver
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene
from drl_av.driving.wide_observation import WIDE_SIZE
from drl_av.env.custom import NOTHING_CUSTOM
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.errors import CheckpointError, ConfigError, RunError
from drl_av.files.table import append_rows
from drl_av.learning import large_scale
from drl_av.learning.large_scale import learner_of, save_actor, train_at_scale
from drl_av.learning.twin_worlds import TwinWorlds
from drl_av.safety.check import Rule, SafetyCheck, Verdict, permit_all

SMALL = (
    PRESETS["large"]
    .updated("ppo", decisions=512, worlds=8, batch_size=128, minibatch_size=64)
    .updated("ppo", lane_units=3, hidden_1=6, hidden_2=5)
    .updated("traffic", vehicles_max=6)
)
NOTHING = np.zeros(0, np.float32)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small training."""
    folder = tmp_path_factory.mktemp("runs") / "large"
    for _ in train_at_scale(folder, SMALL):
        pass
    return folder


def choosing(check: SafetyCheck, *order: int) -> MaskedPolicyDriver:
    """A driver whose logits fall in this order of action numbers."""
    bias = np.full(12, -9.0, np.float32)
    bias[[*order]] = np.arange(len(order), 0, -1)
    layers = [(np.zeros((12, INPUTS), np.float32), bias)]
    return MaskedPolicyDriver(layers, check, Config())


def only(*numbers: int) -> SafetyCheck:
    """A check that permits these actions, and replaces each other by braking."""

    def check(scene: Scene, proposed: Action) -> Verdict:
        if proposed.number in numbers:
            return Verdict(proposed, Rule.NONE)
        return Verdict(ACTIONS[3 if proposed.number != 3 else 2], Rule.IN_LANE)

    return check


def test_it_takes_the_best_action_that_the_check_permits() -> None:
    seen = scene(ahead(30), behind(20, LEFT))
    assert choosing(permit_all, 8, 1).act(seen, NOTHING).number == 8
    assert choosing(only(1, 2), 8, 2, 1).act(seen, NOTHING).number == 2
    # nothing permitted: the check replaces the best one
    assert choosing(only(), 8, 2).act(seen, NOTHING).number == 8


def test_the_network_sees_the_wide_observation_and_then_the_mask() -> None:
    seen = scene(ahead(30), speed_m_s=26.0)
    weight = np.zeros((12, INPUTS), np.float32)
    weight[5, WIDE_SIZE - 12] = 1.0  # the ego's speed: (26 - 20) / 10
    weight[7, WIDE_SIZE + 2] = 0.5  # whether action 2 is permitted
    layers = [(weight, np.zeros(12, np.float32))]
    assert MaskedPolicyDriver(layers, permit_all, Config()).act(seen, NOTHING).number == 5
    slow = scene(ahead(30), speed_m_s=24.0)
    assert MaskedPolicyDriver(layers, permit_all, Config()).act(slow, NOTHING).number == 7
    without = MaskedPolicyDriver(layers, only(5, 7), Config())
    assert without.act(slow, NOTHING).number == 5


def test_each_lane_is_seen_with_the_same_weights_and_the_ego_apart(run: Path) -> None:
    [(weight, bias), *_], _ = load_actor(run / "policy.safetensors")
    assert weight.shape == (6 * 3, 5 * 24 + WIDE_SIZE - 120 + 12)
    left = weight.copy()
    for lane in range(5):
        rows, seen = slice(3 * lane, 3 * lane + 3), slice(24 * lane, 24 * lane + 24)
        assert (weight[rows, seen] == weight[:3, :24]).all()
        assert (bias[rows] == bias[:3]).all()
        left[rows, seen] = 0.0
    assert (weight[:3, :24] != 0.0).all()
    assert (left[15:, 120:] != 0.0).all()
    left[15:, 120:] = 0.0
    assert (left == 0.0).all()


def test_a_policy_file_decides_as_the_network_that_learned(tmp_path: Path) -> None:
    for units in (0, 3):
        config = SMALL.updated("ppo", lane_units=units)
        learner = learner_of(config, TwinWorlds(config, 0))
        save_actor(tmp_path / "policy.safetensors", learner, config)
        layers, _ = load_actor(tmp_path / "policy.safetensors")
        seen = np.random.default_rng(3).normal(size=(50, INPUTS)).astype(np.float32)
        with torch.no_grad():
            hidden = learner.policy.mlp_extractor.forward_actor(torch.from_numpy(seen))
            logits = learner.policy.action_net(hidden).numpy()
        assert forward(layers, seen)[1] == pytest.approx(logits, abs=1e-6)


def test_a_training_that_is_stopped_leaves_what_it_has_learned(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def append(table: Path, *rows: Any) -> None:
        assert table.with_name("policy.safetensors").exists()  # what the row says is saved
        append_rows(table, *rows)

    monkeypatch.setattr(large_scale, "append_rows", append)
    with closing(train_at_scale(tmp_path / "short", SMALL)) as training:
        next(training)  # one of four updates, before the first regular save of a longer one
        with pytest.raises(RunError, match="exists already: choose another folder"):
            next(train_at_scale(tmp_path / "short", SMALL))
        (tmp_path / "short" / "policy.safetensors").unlink()
    weights, _ = load_actor(tmp_path / "short" / "policy.safetensors")
    ends, _ = load_actor(run / "policy.safetensors")
    assert not np.array_equal(weights[0][0], ends[0][0])
    # where its process was killed, train --seeds begins it anew
    train_seed(SeedJob(tmp_path / "short", SMALL, NOTHING_CUSTOM, False))
    assert files_of(tmp_path / "short") == files_of(run)


def test_the_reward_in_the_table_is_what_the_worlds_paid(tmp_path: Path) -> None:
    # the value that PPO adds where the time of an episode is up is no reward
    short = SMALL.updated("simulation", decisions_per_episode=4)
    scale, one = 10.0 * (1.0 - short.ppo.discount), TwinWorlds(short, 0)
    one.step_async(np.zeros(one.num_envs, np.int64))
    rewards = one.step_wait()[1]
    assert one.paid == pytest.approx(rewards.sum() / scale, rel=1e-5)
    worlds = TwinWorlds(short, 0)
    learner = learner_of(short, worlds)
    learner.learn(short.ppo.batch_size)
    assert worlds.paid != pytest.approx(learner.rollout_buffer.rewards.sum() / scale, rel=1e-3)
    progress, *_ = train_at_scale(tmp_path / "run", short)
    assert progress.mean_reward == pytest.approx(worlds.paid / short.ppo.batch_size)


def test_a_policy_with_settings_that_are_gone_is_refused_with_the_remedy(
    run: Path, tmp_path: Path
) -> None:
    tensors, metadata = load(run / "policy.safetensors")
    metadata["config"] = metadata["config"].replace("[learning]\n", "[learning]\nnetworks = 1\n")
    save(tmp_path / "policy.safetensors", tensors, metadata)
    with pytest.raises(CheckpointError, match=r"with other settings .* no key 'networks'"):
        load_actor(tmp_path / "policy.safetensors")


def test_a_program_trains_to_the_same_bytes_and_is_told_what_belongs_to_algorithm_1(
    run: Path, tmp_path: Path
) -> None:
    _ = random.random(), torch.rand(1), np.random.rand()
    before = str((random.getstate(), torch.get_rng_state().tolist(), np.random.get_state()))
    again = drl_av.train(tmp_path / "again", config=SMALL)
    after = str((random.getstate(), torch.get_rng_state().tolist(), np.random.get_state()))
    assert before == after  # the program's random numbers go on
    for name in ("config.toml", "updates.csv", "policy.safetensors"):
        assert (again / name).read_bytes() == (run / name).read_bytes()
    other = drl_av.train(tmp_path / "seed-1", config=SMALL, seed=1)
    folders = again, other
    [weights, others] = (load_actor(each / "policy.safetensors")[0][0][0] for each in folders)
    assert not np.array_equal(weights, others)
    with pytest.raises(ConfigError, match="belong to the training by Algorithm 1"):
        drl_av.train(tmp_path / "other", config=SMALL, episodes=2)
    assert not (tmp_path / "other").exists()


def test_the_run_drives_in_sumo_under_its_own_check_beside_a_rule(run: Path) -> None:
    rows = drl_av.evaluate(
        [run, "gap-mobil"],
        vehicles=3,
        episodes=1,
        seed=800_000,
        config={"simulation": {"decisions_per_episode": 5}},
    )
    assert [row.driver for row in rows] == ["large", "gap-mobil"]
    assert {row.safety_check for row in rows} == {"strict"}
    assert rows[0].safety_triggers == 0  # it proposes only what the check permits


def test_a_driver_of_another_range_and_a_damaged_file_are_refused(
    run: Path, tmp_path: Path
) -> None:
    with pytest.raises(RunError, match=r"another observation\.range_m"):
        load_driver(run, {"observation": {"range_m": 200.0}})
    cut = tmp_path / "policy.safetensors"
    cut.write_bytes((run / "policy.safetensors").read_bytes()[:-100])
    with pytest.raises(CheckpointError, match="cut short"):
        load_driver(cut)
    other = tmp_path / "other"
    shutil.copytree(run, other)
    replace_in(other / "config.toml", "max_speed_m_s = 30.0", "max_speed_m_s = 25.0")
    with pytest.raises(CheckpointError, match="belongs to other settings than"):
        load_driver(other)
    load_driver(other / "policy.safetensors")


def test_a_folder_that_is_not_empty_is_left_alone_and_not_said_to_be_resumable(
    run: Path, capsys: Capsys
) -> None:
    with pytest.raises(RunError, match="exists already"):
        next(train_at_scale(run, SMALL))
    assert main(["train", "--out", str(run), "--preset", "paper"]) == 1
    assert capsys.readouterr().err.endswith("exists already: choose another folder with --out.\n")
    for words in ([], ["--preset", "large"], ["--preset", "large-exit"]):
        assert main(["train", "--out", str(run), "--resume", *words]) == 1
        assert "holds a training at scale, which cannot continue" in capsys.readouterr().err


def test_the_environment_gives_the_wide_observation_by_its_name() -> None:
    env = gymnasium.make("drl_av/Highway-v0", observation="wide")
    with closing(env):
        observation, _ = env.reset(seed=1_000_001, options={"vehicles": 5})
        assert observation.shape == (WIDE_SIZE,)
        assert env.observation_space.contains(observation)
        after = env.step(1)[0]
        assert env.observation_space.contains(after)
        assert not np.array_equal(after, observation)
    with pytest.raises(ConfigError, match="the groups are: wide alone, own_front"):
        gymnasium.make("drl_av/Highway-v0", observation="broad")


def test_the_onnx_file_decides_as_the_driver(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "driver.onnx"
    assert main(["export", str(run), str(file)]) == 0
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(0)
    observation = rng.normal(size=(500, WIDE_SIZE)).astype(np.float32)
    mask = rng.random((500, 12)) < 0.3
    mask[0] = False
    observation[250:] *= 1e6  # logits that differ by more than thousands
    actions, logits = session.run(None, {"observation": observation, "action_mask": mask})
    layers, _ = load_actor(run / "policy.safetensors")
    for row in range(500):
        values = forward(layers, np.concatenate((observation[row], mask[row]), dtype=np.float32))[1]
        assert np.allclose(logits[row], values, rtol=1e-4, atol=1e-5 + 1e-6 * abs(values).max())
        ranked = values if not mask[row].any() else np.where(mask[row], values, -np.inf)
        assert actions[row] == ranked.argmax(), row
    with pytest.raises(CheckpointError, match="by its name, or the folder of its run"):
        load_driver(file)


def first_three(env: HighwayEnv, driver: Driver) -> list[Action]:
    return [each.proposed for each in islice(rollout(env, driver, 800_001, 4), 3)]


def test_the_driver_needs_no_observation_of_the_environment(run: Path) -> None:
    driver = load_driver(run)
    with closing(HighwayEnv(safety_check="strict")) as env:
        proposed = first_three(env, driver)
        wide = HighwayEnv(safety_check="strict", observation="wide")
        with closing(wide):
            again = first_three(wide, driver)
    assert proposed == again


@pytest.mark.parametrize(("scenario", "told"), [("lane_drop", 1), ("straight", 0)])
def test_it_says_where_it_does_not_see_that_a_lane_ends(scenario: str, told: int) -> None:
    config = {"simulation": {"scenario": scenario}, "safety": {"check": "strict"}}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        load_driver("pretrained", config)
    words = [str(each.message) for each in said]
    assert len(words) == told
    assert all(f"does not see where a lane ends or leaves, as on {scenario}" in w for w in words)


def test_what_the_twin_lacks_is_not_trained_at_scale_and_the_way_out_is_another_preset(
    tmp_path: Path, capsys: Capsys
) -> None:
    words = ["train", "--preset", "large", "--out", str(tmp_path / "run")]
    assert main([*words, "-o", "simulation.step_length_s=0.25"]) == 1
    assert capsys.readouterr().err == (
        "drl-av: PPO at scale learns in the twin. The twin does not know a "
        "simulation.step_length_s other than 0.5: take --preset paper or paper-merge.\n"
    )
    assert main([*words, "--safety-check", "mine:check"]) == 1
    assert capsys.readouterr().err.endswith(
        "but not mine:check: name one of them, or take --preset paper or paper-merge.\n"
    )


@pytest.mark.parametrize(
    "numbers",
    [
        "worlds=1 batch_size=64 decisions=128 minibatch_size=64",
        "worlds=7 batch_size=100 decisions=200 minibatch_size=50",
        "worlds=8 batch_size=64 decisions=63 minibatch_size=64",
        "worlds=8 batch_size=64 decisions=64 minibatch_size=63",
        "worlds=8 batch_size=64 decisions=64 minibatch_size=128",
    ],
)
def test_numbers_of_ppo_that_do_not_fit_each_other_are_refused_before_a_folder_is_made(
    numbers: str, tmp_path: Path, capsys: Capsys
) -> None:
    options = [word for number in numbers.split() for word in ("-o", f"ppo.{number}")]
    out = tmp_path / "run"
    assert main(["train", "--preset", "large", "--out", str(out), *options]) == 1
    assert "worlds at least 5, one for each kind" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("preset", "setting"), [("large", "learning.batch_size=32"), ("paper", "ppo.decisions=100")]
)
def test_a_setting_that_the_other_training_has_is_not_ignored(
    preset: str, setting: str, tmp_path: Path, capsys: Capsys
) -> None:
    out = tmp_path / "run"
    assert main(["train", "--preset", preset, "--out", str(out), "-o", setting]) == 1
    assert f"{setting.split('=')[0]} belongs to" in capsys.readouterr().err
    assert not out.exists()
