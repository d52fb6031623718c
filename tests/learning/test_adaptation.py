"""Continuous adaptation: a trained driver drives greedily and learns on, in a run of its own."""

import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
from runs import INTERRUPT, KILL, Capsys, error_message, files_of, interrupted, run_folder

from drl_av.cli import main
from drl_av.config import Config, TrafficConfig, load_config
from drl_av.config.presets import adaptation
from drl_av.drivers.learned import network_values
from drl_av.drivers.policy_file import SHIPPED, load, load_policy
from drl_av.env.highway import HighwayEnv
from drl_av.errors import CheckpointError
from drl_av.evaluation.table import read_rows
from drl_av.learning.algorithm_1 import build_training
from drl_av.learning.run_folder import open_training, warm_start

TRAINED = """
[simulation]
decisions_per_episode = 15
[learning]
episodes = 4
seed = 2
target_update_episodes = 3
evaluate_every = 4
evaluation_episodes = 1
"""
QUICK = """
[learning]
episodes = 5
collisions_to_start = 1
evaluate_every = 3
checkpoint_every = 2
evaluation_episodes = 1
"""
R_COL = Config().reward.collision_reward


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a checkpoint, hardly trained: greedily, it proposes what is not safe."""
    folder = tmp_path_factory.mktemp("runs") / "trained"
    settings = folder.with_name("trained.toml")
    settings.write_text(TRAINED)
    assert main(["train", "--out", str(folder), "--config", str(settings)]) == 0
    return folder


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("settings") / "quick.toml"
    path.write_text(QUICK)
    return str(path)


@pytest.fixture(scope="module")
def adapted(trained: Path, quick: str) -> Path:
    """That run's driver, adapted; not to be changed."""
    return adapt(trained, quick, "adapted", "--learning-rate", "1e-3")


@pytest.fixture(scope="module")
def frozen(trained: Path, quick: str) -> Path:
    """The same driver without learning."""
    return adapt(trained, quick, "frozen", "--learning-rate", "0")


def command(trained: Path, quick: str, name: str, *options: str) -> list[str]:
    run = [] if "--resume" in options else [str(trained)]
    return ["adapt", *run, "--out", str(trained.with_name(name)), "--config", quick, *options]


def adapt(trained: Path, quick: str, name: str, *options: str) -> Path:
    assert main(command(trained, quick, name, *options)) == 0
    return trained.with_name(name)


def tensors(folder: Path) -> dict[str, np.ndarray]:
    return load(folder / "checkpoint.safetensors")[0]


def rows(folder: Path) -> list[dict[str, str]]:
    return read_rows(folder / "episodes.csv")


def test_it_is_a_run_like_any_other(adapted: Path, trained: Path) -> None:
    assert set(files_of(adapted)) == set(files_of(trained))
    assert len(rows(adapted)) == 5
    assert [row["episode"] for row in read_rows(adapted / "evaluations.csv")] == ["3", "5"]


def test_settings_are_the_runs_but_for_what_adaptation_is(adapted: Path, trained: Path) -> None:
    found, before = (load_config(folder / "config.toml") for folder in (adapted, trained))
    assert found.simulation == before.simulation
    learning = found.learning
    assert (learning.epsilon_start, learning.epsilon_end, learning.learning_rate) == (0, 0, 1e-3)
    assert (learning.seed, learning.target_update_episodes, learning.episodes) == (3, 3, 5)


def test_a_driver_that_learned_fast_is_adapted_slowly_too() -> None:
    fast = {"learning_rate": 3e-3, "learning_rate_end_fraction": 0.01, "gradient_steps": 3}
    learning = adaptation(Config().updated("learning", batch_size=256, **fast)).learning
    assert learning.learning_rate == 1e-5 < Config().learning.learning_rate
    assert (learning.learning_rate_end_fraction, learning.gradient_steps) == (1.0, 1)
    assert (learning.episodes, learning.batch_size) == (30_000, 64)
    assert learning.collisions_to_start == 64
    few = adaptation(Config().updated("learning", collision_capacity=50))
    assert few.learning.collisions_to_start == 50


def test_it_has_the_numbers_of_vehicles_of_a_run_among_all_kinds(tmp_path: Path) -> None:
    few = {"vehicles_min": 3, "vehicles_max": 5}
    run_folder(tmp_path / "run", Config().with_traffic("all").updated("traffic", **few))
    words = "--episodes 1 -o simulation.decisions_per_episode=2 -o learning.evaluation_episodes=1"
    assert main(f"adapt {tmp_path}/run --out {tmp_path}/adapted {words}".split()) == 0
    assert load_config(tmp_path / "adapted" / "config.toml").traffic == TrafficConfig(**few)


def test_every_violation_lands_in_the_collision_buffer_beside_the_trainings_own(
    adapted: Path, trained: Path
) -> None:
    before, after = tensors(trained)["buffer.collision.rows"], tensors(adapted)
    violations = sum(int(row["safety_triggers"]) for row in rows(adapted))
    crashes = sum(row["collided"] == "True" for row in rows(adapted))
    assert violations > 0
    collisions = after["buffer.collision.rows"]
    np.testing.assert_array_equal(collisions[: len(before)], before)
    assert len(collisions) == len(before) + violations + crashes
    assert set(map(tuple, collisions[:, -2:])) == {(R_COL, 0.0)}
    decisions = sum(int(row["decisions"]) for row in rows(adapted))
    safe = len(tensors(trained)["buffer.safe.rows"])
    assert len(after["buffer.safe.rows"]) == safe + decisions - crashes


def test_what_it_proposes_is_what_the_trained_network_values_most(
    frozen: Path, trained: Path
) -> None:
    network, _ = load_policy(trained / "policy.safetensors")
    values, known = network_values(network), len(tensors(trained)["buffer.collision.rows"])
    overruled = tensors(frozen)["buffer.collision.rows"][known:]
    if any(row["collided"] == "True" for row in rows(frozen)):
        pytest.fail("choose another seed: a collision blames what was executed")
    assert len(overruled) > 0
    for row in overruled:
        assert values(row[:27]).argmax() == row[-3]
    assert {row["epsilon"] for row in rows(frozen)} == {"0.0"}


def test_only_the_one_with_a_learning_rate_learns(
    adapted: Path, frozen: Path, trained: Path
) -> None:
    before, learnt, same = (tensors(folder) for folder in (trained, adapted, frozen))
    for name in ("online", "first_moment", "second_moment", "step"):
        np.testing.assert_array_equal(same[f"learner.{name}"], before[f"learner.{name}"])
    decisions = sum(int(row["decisions"]) for row in rows(adapted))
    assert learnt["learner.step"] == before["learner.step"] + decisions
    assert not np.array_equal(learnt["learner.online"], before["learner.online"])
    assert {row["mean_loss"] for row in rows(frozen)} == {"0.0"}


def test_the_paper_s_driver_brings_its_policy_and_waits_for_experience(
    tmp_path: Path, capsys: Capsys
) -> None:
    settings = tmp_path / "short.toml"
    settings.write_text("simulation.decisions_per_episode=5\nlearning.evaluation_episodes=1\n")
    out = tmp_path / "adapted"
    words = ["adapt", "--out", str(out), "--episodes", "2", "--config", str(settings)]
    assert main(words) == 0
    assert load_config(out / "config.toml").safety.check == "paper"  # that of its training
    network, _ = load_policy(SHIPPED["pretrained-paper"] / "policy.safetensors")
    for name in ("online", "target"):
        np.testing.assert_array_equal(tensors(out)[f"learner.{name}"], network.flat)
    assert tensors(out)["learner.step"] == 0
    assert len(tensors(out)["buffer.safe.rows"]) == 10
    without = "pretrained-paper comes without the experience of its training"
    assert f"{without}: it learns from 64 collision" in capsys.readouterr().err


def test_a_policy_file_of_another_name_comes_without_the_experience_beside_it(
    trained: Path, quick: str, tmp_path: Path
) -> None:
    out, best = tmp_path / "adapted", tmp_path / "best.safetensors"
    shutil.copy(trained / "policy.safetensors", best)
    shutil.copy(trained / "checkpoint.safetensors", tmp_path)
    assert main(["adapt", str(best), "--out", str(out), "--config", quick, "--episodes", "1"]) == 0
    driven = int(rows(out)[0]["decisions"])
    assert 0 < len(tensors(out)["buffer.safe.rows"]) <= driven


def test_killed_or_stopped_by_ctrl_c_it_ends_with_the_same_bytes(
    trained: Path, quick: str, adapted: Path
) -> None:
    folder = trained.with_name("killed")
    words = command(trained, quick, "killed", "--learning-rate", "1e-3")
    resumed = ["adapt", f"--out={folder}", "--resume"]
    for moment in ("HighwayEnv, 'execute', 7", "run_folder.Run, 'append', 4"):
        ended = interrupted(f"at_call({moment}, {KILL})", words)
        assert ended.returncode == -signal.SIGKILL
        words = resumed
    assert len(rows(folder)) == 3
    ended = interrupted(f"at_call(HighwayEnv, 'execute', 2, {INTERRUPT})", words)
    assert ended.returncode == 130
    assert f"continue with: drl-av {' '.join(resumed)}\n" in ended.stderr
    # the verb that trains can finish it as well
    assert main(["train", *resumed[1:]]) == 0
    assert files_of(folder) == files_of(adapted)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["idm"], "idm is not a driver that drl-av trained"),
        (["imd"], "did you mean 'idm'"),
        (["."], "holds no trained driver"),
        (["pretrained"], "pretrained learned by PPO, which has no continual adaptation: give a"),
        (["--learning-rate", "2"], "learning.learning_rate is 2.0, but must be a number from"),
        (["--learning-rate", "nan"], "learning.learning_rate is nan"),
        (["-o", "learning.algorithm=ppo"], "learning.algorithm is ppo, but this training is by"),
        (["--config", "narrow.toml"], "does not fit learning.hidden_units, learning.replay or the"),
        (["--config", "blind.toml"], "was trained with other [observation] settings"),
        (["--resume"], "is not a run: it has no config.toml"),
    ],
)
def test_a_policy_that_cannot_be_adapted_is_reported_and_leaves_nothing_behind(
    words: list[str], message: str, here: Path, capsys: Capsys
) -> None:
    (here / "narrow.toml").write_text("[learning]\nhidden_units = 7\n")
    (here / "blind.toml").write_text("[observation]\nrange_m = 100\n")
    given = set(here.iterdir())
    assert main(["adapt", *words, "--out", "out"]) == 1
    assert message in error_message(capsys)
    assert set(here.iterdir()) == given


def test_a_run_that_is_there_is_not_begun_again_nor_resumed_otherwise(
    trained: Path, quick: str, adapted: Path, capsys: Capsys
) -> None:
    before = files_of(adapted)
    for options, message in (
        ([], "exists already: continue it with --resume"),
        (["--resume", "--learning-rate", "0"], "was begun with other settings"),
        (["--resume", "--seed", "9"], "was begun with other settings"),
    ):
        assert main(command(trained, quick, "adapted", *options)) == 1
        assert message in error_message(capsys)
    assert main(["adapt", str(trained), "--out", str(adapted), "--resume"]) == 1
    assert "with the driver that it began with: leave" in error_message(capsys)
    assert files_of(adapted) == before
    assert main(command(trained, quick, "adapted", "--resume")) == 0


def test_experience_of_another_replay_is_not_dropped_in_silence(
    trained: Path, tmp_path: Path, capsys: Capsys
) -> None:
    for settings in ("replay=uniform", "replay=prioritized", "safe_capacity=1"):
        words = ["adapt", str(trained), "--out", str(tmp_path / "out")]
        assert main([*words, "-o", f"learning.{settings}"]) == 1
        assert "does not fit learning.hidden_units, learning.replay or" in error_message(capsys)
        assert not (tmp_path / "out").exists()


def test_a_checkpoint_that_is_none_is_refused(trained: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(trained, tmp_path / "copy"))
    shutil.copy(folder / "policy.safetensors", folder / "checkpoint.safetensors")
    env = HighwayEnv(config=load_config(folder / "config.toml"))
    with env, pytest.raises(CheckpointError, match="is not a training's"):
        warm_start(build_training(env), folder / "policy.safetensors")


def test_experience_with_the_user_s_own_reward_is_not_mixed_with_another(
    quick: str, here: Path, capsys: Capsys
) -> None:
    Path("mine.py").write_text("def one(transition):\n    return 1.0\n")
    Path("trained.toml").write_text(TRAINED)
    words = ["train", "--out", "paid", "--config", "trained.toml", "--reward", "mine:one"]
    assert main(words) == 0
    again = ["adapt", "paid", "--out", "on", "--config", quick]
    capsys.readouterr()
    assert main(again) == 1
    assert "was trained with --reward mine:one" in error_message(capsys)
    assert not Path("on").exists()
    words = [*again, "--reward", "mine:one"]
    capsys.readouterr()
    for name in ("learning.discount=0.5", "reward.collision_reward=-30", "safety.minimum_gap_m=9"):
        assert main([*words, "-o", name]) == 1
        assert "[reward], learning.discount and gap condition" in error_message(capsys)
    assert main([*words, "--sumo-options=--no-such-option 3"]) == 1
    assert "--resume" in error_message(capsys)
    assert main(["adapt", "--out", "on", "--resume"]) == 1
    assert "begun with --reward mine:one: give all" in error_message(capsys)
    assert main(["adapt", "--out", "on", "--resume", "--reward", "mine:one"]) == 0
    Path("mine.py").write_text("def one(transition):\n    return -1.0\n")
    assert main(["adapt", "paid", "--out", "off", "--reward", "mine:one"]) == 1
    assert "trained with --reward mine:one and with the" in error_message(capsys)


def test_an_adaptation_that_is_stopped_at_once_has_the_driver_that_it_began_with(
    trained: Path, quick: str, tmp_path: Path
) -> None:
    config = adaptation(load_config(trained / "config.toml"))
    policy = trained / "policy.safetensors"
    with open_training(tmp_path / "a", config, prepare=lambda t: warm_start(t, policy)):
        pass
    before, after = (load(folder / "policy.safetensors")[0] for folder in (trained, tmp_path / "a"))
    assert before.keys() == after.keys()
    assert all(np.array_equal(before[name], after[name]) for name in before)
