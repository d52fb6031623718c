"""A run's folder: killed, stopped, starved and spoilt, it loses nothing that was saved."""

import os
import shutil
import signal
import sys
import threading
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from nets import east
from runs import (
    INTERRUPT,
    KILL,
    Capsys,
    disk_tape,
    error_message,
    files_of,
    interrupted,
    one_sentence,
)

from drl_av.cli import main
from drl_av.config import load_config
from drl_av.drivers.policy_file import load, load_policy, save
from drl_av.env.highway import HighwayEnv
from drl_av.errors import DrlAvError, RunError
from drl_av.learning.algorithm_1 import EvaluationRow, build_training
from drl_av.learning.run_folder import Run, open_training, train
from drl_av.learning.train import tensorboard_writer
from drl_av.scenarios.folder import write_scenario

EPISODES = 9
SETTINGS = f"""
[simulation]
decisions_per_episode = 20
[learning]
episodes = {EPISODES}
evaluate_every = 3
checkpoint_every = 2
evaluation_episodes = 2
mirrored = true
"""
RESULTS = ("episodes.csv", "evaluations.csv", "checkpoint.safetensors", "policy.safetensors")
MOMENTS = {
    "before the run is there": f"at_call(os, 'replace', 1, {KILL})",
    "in the first episode": f"at_call(HighwayEnv, 'execute', 7, {KILL})",
    "before the policy is named": f"at_call(os, 'replace', 1, {KILL})",
    "between policy and checkpoint": f"at_call(os, 'replace', 2, {KILL})",
    "before the checkpoint is on disk": f"at_call(os, 'fsync', 7, {KILL})",
    "between row and evaluation": f"at_call(run_folder.Run, 'append', 3, {KILL}, after=True)",
    "in an evaluation": f"at_call(HighwayEnv, 'reset', 5, {KILL})",
}


def command(folder: Path, *options: str) -> list[str]:
    return ["train", "--out", str(folder), *options]


def require_refused(folder: Path, message: str, capsys: Capsys, *options: str) -> None:
    """The training does not go on: one sentence says why, and no file changes."""
    before = files_of(folder)
    assert main(command(folder, *options)) == 1
    assert message in error_message(capsys)
    assert files_of(folder) == before


def require_ended_like(left_alone: Path, folder: Path) -> None:
    """Resumed, the training ends with the same bytes as one that was left alone."""
    assert interrupted("", command(folder, "--resume")).returncode == 0
    assert files_of(folder) == files_of(left_alone)


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("settings") / "tiny.toml"
    path.write_text(SETTINGS)
    return str(path)


@pytest.fixture(scope="module")
def left_alone(settings: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run without any interruption; not to be changed."""
    folder = tmp_path_factory.mktemp("runs") / "left_alone"
    assert main(command(folder, "--config", settings)) == 0
    return folder


@pytest.fixture
def copy(left_alone: Path, tmp_path: Path) -> Path:
    """The same run, to spoil."""
    return Path(shutil.copytree(left_alone, tmp_path / "copy"))


def test_run_killed_at_many_moments_ends_with_the_same_bytes(
    settings: str, left_alone: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "killed"
    for moment, prelude in MOMENTS.items():
        options = ["--resume"] if folder.exists() else ["--config", settings]
        ended = interrupted(prelude, command(folder, *options))
        assert ended.returncode == -signal.SIGKILL, (moment, ended.stderr)
    require_ended_like(left_alone, folder)


def test_run_on_a_road_from_openstreetmap_is_resumed_as_exactly(
    settings: str, tmp_path: Path
) -> None:
    write_scenario(tmp_path / "a10", east())
    road = ["--config", settings, "--scenario", str(tmp_path / "a10"), "--episodes", "4"]
    assert main(command(tmp_path / "left_alone", *road)) == 0
    folder = tmp_path / "killed"
    for moment in ("in the first episode", "between policy and checkpoint"):
        options = ["--resume"] if folder.exists() else road
        ended = interrupted(MOMENTS[moment], command(folder, *options))
        assert ended.returncode == -signal.SIGKILL, ended.stderr
    require_ended_like(tmp_path / "left_alone", folder)


def test_sumo_that_ends_on_its_own_is_reported_with_the_command_to_continue(
    settings: str, left_alone: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "ended"
    prelude = "import libsumo; at_call(libsumo, 'simulationStep', 190, libsumo.close)"
    ended = interrupted(prelude, command(folder, "--config", settings))
    assert ended.returncode == 1
    message = one_sentence(ended.stderr)
    assert "SUMO ended on its own" in message
    again = f"drl-av train --out={folder} --resume."
    assert f"continues from its last checkpoint with: {again}" in message
    require_ended_like(left_alone, folder)


@pytest.mark.parametrize(("steps", "episodes"), [((50,), 3), ((45, 47), 2)])
def test_first_ctrl_c_stops_after_the_episode_and_the_second_at_once(
    steps: tuple[int, ...], episodes: int, settings: str, left_alone: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "stopped"
    prelude = "\n".join(f"at_call(HighwayEnv, 'execute', {n}, {INTERRUPT})" for n in steps)
    ended = interrupted(prelude, command(folder, "--config", settings))
    assert ended.returncode == 130
    assert f"drl-av train --out={folder} --resume" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert len((folder / "episodes.csv").read_bytes().splitlines()) == 1 + episodes
    assert load(folder / "checkpoint.safetensors")[1]["episodes_done"] == episodes
    require_ended_like(left_alone, folder)


def test_resuming_a_finished_run_does_nothing_also_if_it_repeats_what_it_was_begun_with(
    settings: str, copy: Path
) -> None:
    before = {path.name: path.stat().st_mtime_ns for path in copy.iterdir()}
    for options in ((), ("--preset", "paper", "--config", settings)):
        assert main(command(copy, "--resume", *options)) == 0
        assert {path.name: path.stat().st_mtime_ns for path in copy.iterdir()} == before


def test_resuming_a_finished_run_writes_a_policy_that_is_gone_or_damaged(copy: Path) -> None:
    before = files_of(copy)
    for spoil in (os.remove, lambda file: os.truncate(file, 40_000)):
        spoil(copy / "policy.safetensors")
        assert main(command(copy, "--resume")) == 0
        assert files_of(copy) == before


def test_a_training_does_not_go_on_upon_another_road(
    settings: str, tmp_path: Path, capsys: Capsys
) -> None:
    road, run = tmp_path / "road", tmp_path / "run"
    assert main(["scenario", str(road), "--circumference-m", "800"]) == 0
    words = command(run, "--config", settings, "--scenario", str(road))
    assert interrupted(f"at_call(HighwayEnv, 'execute', 60, {KILL})", words).returncode != 0
    shutil.rmtree(road)
    assert main(["scenario", str(road), "--circumference-m", "400"]) == 0
    capsys.readouterr()
    other = f"with other files of the scenario {road}: give all"
    require_refused(run, other, capsys, "--resume")


@pytest.mark.parametrize(
    ("limit", "mode", "reason"),
    [
        *((size, 0o755, "File too large") for size in (30_000, 100_000)),
        (None, 0o555, "Permission denied"),
    ],
)
def test_a_folder_that_takes_no_more_keeps_what_was_saved(
    limit: int | None, mode: int, reason: str, settings: str, left_alone: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "starved"
    stopped = interrupted(
        f"at_call(HighwayEnv, 'execute', 70, {INTERRUPT})", command(folder, "--config", settings)
    )
    assert stopped.returncode == 130
    saved = {name: (folder / name).read_bytes() for name in RESULTS}
    folder.chmod(mode)
    ended = interrupted("without_root_rights()", command(folder, "--resume"), limit)
    folder.chmod(0o755)
    assert ended.returncode == 1
    assert f"cannot be written ({reason})" in one_sentence(ended.stderr)
    assert (folder / "checkpoint.safetensors").read_bytes() == saved["checkpoint.safetensors"]
    assert load_policy(folder / "policy.safetensors")
    assert not list(folder.glob(".*unfinished*"))
    require_ended_like(left_alone, folder)


def test_row_that_finds_the_disk_full_is_reported_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"No space left on device.*--resume"):
        Run(tmp_path).append(Path("/dev/full"), EvaluationRow(*[0] * 9))


@pytest.mark.parametrize("spoilt", ["cut short", "flipped", "empty", "a policy"])
def test_damaged_checkpoint_is_refused_and_left_as_it_is(
    spoilt: str, copy: Path, capsys: Capsys
) -> None:
    file = copy / "checkpoint.safetensors"
    data = bytearray(file.read_bytes())
    if spoilt == "flipped":
        data[len(data) // 2] ^= 1
    elif spoilt == "a policy":
        data = bytearray((copy / "policy.safetensors").read_bytes())
    else:
        data = data[: len(data) // 2 if spoilt == "cut short" else 0]
    file.write_bytes(data)
    require_refused(copy, str(file), capsys, "--resume")


@pytest.mark.parametrize("spoilt", ["seed = 3\n", "seed = 0\nforgotten = 1\n"])
def test_checkpoint_of_another_config_is_refused(spoilt: str, copy: Path, capsys: Capsys) -> None:
    file = copy / "checkpoint.safetensors"
    tensors, numbers = load(file)
    config = numbers["config"].replace("seed = 0\n", spoilt)
    save(file, tensors, numbers | {"config": config})
    require_refused(copy, "belongs to other settings", capsys, "--resume")


def test_a_config_that_a_power_cut_left_is_refused_before_anything_is_interrupted(
    copy: Path, capsys: Capsys
) -> None:
    whole = (copy / "config.toml").read_bytes()
    last_zero = whole.rindex(b"evaluation_episodes = 2") + len(b"evaluation_episodes = ")
    for left in (b"", whole[: len(whole) // 2], whole[:-2], whole[:last_zero]):
        (copy / "config.toml").write_bytes(left)
        require_refused(copy, str(copy / "config.toml"), capsys, "--resume")


def test_without_its_checkpoint_a_run_is_not_continued_and_stays_as_it_is(
    copy: Path, tmp_path: Path, settings: str, capsys: Capsys
) -> None:
    adapted = tmp_path / "adapted"
    assert main(["adapt", str(copy), "--out", str(adapted), "--episodes", "1"]) == 0
    for verb, folder in (("train", copy), ("adapt", adapted)):
        (folder / "checkpoint.safetensors").unlink()
        before = files_of(folder)
        capsys.readouterr()
        assert main([verb, "--out", str(folder), "--resume"]) == 1
        assert f"{folder} has no checkpoint.safetensors, from which" in error_message(capsys)
        assert files_of(folder) == before


def test_a_new_run_is_on_the_disk_before_it_has_its_name(
    settings: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(HighwayEnv(config=load_config(settings))) as env:
        training = build_training(env)
        tape = disk_tape(monkeypatch)
        Run(tmp_path / "run").create(training)
    *contents, folder, name, home = tape
    for file in ("config.toml", "episodes.csv", "evaluations.csv", "checkpoint.safetensors"):
        assert f"fsync {file}" in contents
    assert folder == "fsync run"
    assert (name, home) == ("rename run to run", f"fsync {tmp_path.name}")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("episodes_done", 10**18),
        ("episodes_done", -1),
        ("episodes_done", float("inf")),
        ("sizes", {"episodes.csv": float("inf"), "evaluations.csv": 0}),
        ("sizes", {"episodes.csv": -1, "evaluations.csv": 0}),
        ("rng", {"bit_generator": "PCG64", "state": {"state": 10**60, "inc": 1}}),
        ("rng", {"bit_generator": "MT19937"}),
    ],
)
def test_numbers_that_no_training_writes_are_refused_and_change_no_file(
    name: str, value: object, copy: Path, capsys: Capsys
) -> None:
    file = copy / "checkpoint.safetensors"
    tensors, numbers = load(file)
    save(file, tensors, numbers | {name: value})
    require_refused(copy, str(file), capsys, "--resume")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "exists already: continue it with --resume"),
        (["--resume", "--seed", "3"], "was begun with other settings"),
        (["--resume", "--safety-check", "permit_all"], "was begun with other settings"),
        (["--resume", "--preset", "literal"], "was begun with other settings"),
    ],
)
def test_run_that_exists_is_not_trained_otherwise(
    options: list[str], message: str, copy: Path, capsys: Capsys
) -> None:
    require_refused(copy, message, capsys, *options)


def test_tensorboard_events_are_written_when_asked_for(settings: str, tmp_path: Path) -> None:
    folder = tmp_path / "shown"
    arguments = command(folder, "--config", settings, "--episodes", "3", "--tensorboard")
    assert main(arguments) == 0
    [events] = (folder / "tensorboard").glob("events.out.tfevents.*")
    written = events.read_bytes()
    for name in (b"episode/mean_reward", b"episode/epsilon", b"evaluation/mean_speed_m_s"):
        assert name in written


def test_missing_tensorboard_is_reported_before_a_run_is_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setitem(sys.modules, "tensorboard", None)  # importing it fails
    assert main(command(tmp_path / "run", "--tensorboard")) == 1
    assert "pip install 'drl-av[tensorboard]'" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_folder_that_cannot_have_events_leaves_the_reports_of_threads_alone(
    tmp_path: Path,
) -> None:
    before = threading.excepthook
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match="events"), tensorboard_writer(tmp_path / "file" / "in", 0):
        pass
    assert threading.excepthook is before


FULL_DISK = """
from tensorboard.summary.writer.record_writer import RecordWriter
def full(): raise OSError(28, "No space left on device")
at_call(RecordWriter, "write", 9, full)
"""


def test_tensorboard_events_that_find_the_disk_full_are_one_sentence(
    settings: str, left_alone: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    ended = interrupted(FULL_DISK, command(folder, "--config", settings, "--tensorboard"))
    assert ended.returncode == 1
    assert "without --tensorboard" in one_sentence(ended.stderr)
    require_ended_like(left_alone, folder)


def test_a_run_without_an_episode_can_be_corrected(
    settings: str, tmp_path: Path, capsys: Capsys
) -> None:
    begun = [*command(tmp_path / "run"), "--config", settings]
    assert main([*begun, "--sumo-options=--no-such-option 3"]) == 1
    assert "--resume" in error_message(capsys)
    assert main([*command(tmp_path / "run"), "--resume"]) == 0
    assert (tmp_path / "run" / "episodes.csv").read_text().count("\n") == EPISODES + 1


def test_a_training_that_diverges_stops_and_keeps_its_last_checkpoint(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = files_of(copy)
    with open_training(copy, load_config(copy / "config.toml"), resume=True) as (run, training):
        training.episodes_done -= 1
        episode = training.run_episode

        def diverging() -> object:
            row = episode()
            training.network.flat[3] = np.nan
            return row

        monkeypatch.setattr(training, "run_episode", diverging)
        with pytest.raises(DrlAvError, match=f"diverged in episode {EPISODES}: its weights"):
            next(train(run, training))
    assert files_of(copy) == before


def test_what_a_training_would_ignore_is_refused(tmp_path: Path, capsys: Capsys) -> None:
    for words, said in (
        (["-o", "driver.hold_s=2"], "driver.hold_s is 2, but a training would ignore it"),
        (["--preset", "large", "-o", "driver.hold_s=2"], "driver.hold_s is 2"),
        (["--preset", "large", "-o", "reward.collision_reward=-30"], "reward.collision_reward"),
        (["--preset", "large", "-o", "observation.gap_scale_m=50"], "observation.gap_scale_m"),
        (["--preset", "large", "--seed", str(2**32)], "seed is 4294967296, but must be"),
    ):
        assert main([*command(tmp_path / "run"), *words]) == 1
        assert said in error_message(capsys)
        assert not (tmp_path / "run").exists()
