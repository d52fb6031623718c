"""``drl-av train --seeds``: a run for each seed, the same bytes as each run alone."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from runs import TINY, Capsys, error_message, files_of

from drl_av.cli import main
from drl_av.cli.console import INTERRUPTED
from drl_av.cli.seeds import SeedJob, group_of, seed_list, train_seed
from drl_av.config.presets import preset
from drl_av.drivers.groups import trainings_of
from drl_av.drivers.registry import driver_names
from drl_av.env.custom import NOTHING_CUSTOM
from drl_av.errors import SimulationError
from drl_av.evaluation import LOKY
from drl_av.evaluation.engines import ENGINES


@pytest.fixture
def settings(here: Path) -> str:
    Path("tiny.toml").write_text(TINY.updated("learning", episodes=4).to_toml())
    return "tiny.toml"


def test_the_words_of_seeds() -> None:
    assert seed_list("1-3,7,2") == [1, 2, 3, 7]


@pytest.mark.parametrize("words", ["", "3-1", "a", "1-", "-1", "1,,2", "0-999999999"])
def test_wrong_seeds_are_refused(words: str, capsys: Capsys) -> None:
    with pytest.raises(SystemExit):
        main(["train", "--out", "run", "--seeds", words])
    assert "--seeds" in capsys.readouterr().err


def test_the_command_that_compares_names_the_own_check(settings: str, capsys: Capsys) -> None:
    Path("own_check.py").write_text("from drl_av.safety.check import permit_all as free\n")
    words = ["train", "--config", settings, "--out", "many", "--seeds", "3"]
    assert main([*words, "--safety-check", "own_check:free"]) == 0
    assert "gap-mobil --safety-check=own_check:free\n" in capsys.readouterr().out


def test_each_run_has_the_bytes_of_the_same_run_alone(settings: str, capsys: Capsys) -> None:
    words = ["train", "--config", settings]
    assert main([*words, "--out", "many", "--seeds", "3,4", "--jobs", "2"]) == 0
    assert "drl-av evaluate 'many=many/seed-*' gap-mobil" in capsys.readouterr().out
    assert main([*words, "--out", "one", "--seed", "4"]) == 0
    assert {folder.name for folder in Path("many").iterdir()} == {"seed-3", "seed-4"}
    assert files_of(Path("many/seed-4")) == files_of(Path("one"))
    assert files_of(Path("many/seed-3")) != files_of(Path("one"))
    # again: refused, then a run that was stopped early and one that is missing are made
    capsys.readouterr()
    assert main([*words, "--out", "many", "--seeds", "3-5"]) == 1
    assert "many/seed-3 exists already: continue it with --resume" in error_message(capsys)
    whole = files_of(Path("many/seed-3"))
    shutil.rmtree("many/seed-3")
    assert main(["train", "--out", "many", "--seeds", "3,4", "--resume"]) == 0
    assert files_of(Path("many/seed-3")) == whole
    other = ["--seeds", "3,4", "--resume", "--episodes", "9"]
    assert main(["train", "--out", "many", *other]) == 1
    assert "begun with other settings" in error_message(capsys)


@pytest.mark.parametrize("name", ["plain", "my run", "idm", "p[1]", "-x"])
def test_the_printed_word_finds_the_trainings_in_any_folder(name: str, here: Path) -> None:
    for seed in (2, 10):
        (here / name / f"seed-{seed}").mkdir(parents=True)
    group, found = trainings_of(group_of(Path(name)))
    assert found == [f"{name}/seed-2", f"{name}/seed-10"]
    assert group not in driver_names()
    assert group.isidentifier() or group == "idm-seeds"


def test_a_stopped_run_continues_to_the_same_bytes(settings: str) -> None:
    from drl_av.env.highway import HighwayEnv
    from drl_av.learning.algorithm_1 import build_training
    from drl_av.learning.run_folder import Run, train

    config = TINY.updated("learning", episodes=4)
    whole, stopped = (SeedJob(Path(n), config, NOTHING_CUSTOM, False) for n in ("a", "b"))
    train_seed(whole)
    run, env = Run(Path("b")), HighwayEnv(config=config)
    training = build_training(env)
    run.create(training)
    for _ in train(run, training):
        if training.episodes_done == 3:  # one more than the last checkpoint
            break
    env.close()
    assert (stopped.done, stopped.total) == (3, 4)
    train_seed(stopped)
    train_seed(stopped)  # complete: as it is
    assert files_of(Path("b")) == files_of(Path("a"))


def test_a_training_at_scale_that_was_stopped_is_named(here: Path, capsys: Capsys) -> None:
    config = preset("large").updated("ppo", decisions=3, batch_size=1).updated("learning", seed=1)
    folder = Path("runs/seed-1")
    folder.mkdir(parents=True)
    (folder / "config.toml").write_text(config.to_toml())
    (folder / "updates.csv").write_text("decisions,mean_reward,collisions\n1,0.0,0\n2,0.0,0\n")
    job = SeedJob(folder, config, NOTHING_CUSTOM, False)
    assert (job.done, job.total, job.is_stopped) == (2, 3, True)
    assert main(["train", "--out", "runs", "--seeds", "1,2", "--resume"]) == 1
    assert f"{folder} holds a training at scale that was stopped" in error_message(capsys)
    with (folder / "updates.csv").open("a") as table:
        table.write("3,0.0,0\n")
    held = files_of(folder)
    assert not job.is_stopped
    train_seed(job)  # complete: as it is
    assert files_of(folder) == held


def test_a_stop_prints_the_command_that_goes_on_with_the_same_settings(
    settings: str, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    def stop(*arguments: object) -> Iterator[object]:
        raise KeyboardInterrupt
        yield

    words = ["train", "--config", settings, "--out", "many", "--seeds", "3,4", "--tensorboard"]
    monkeypatch.setitem(ENGINES, LOKY, stop)
    for begun, last in ((False, ""), (True, " --resume")):
        if begun:
            Path("many/seed-3").mkdir(parents=True)
            stored = TINY.updated("learning", episodes=4, seed=3)
            Path("many/seed-3/config.toml").write_text(stored.to_toml())
        assert main([*words, *last.split()]) == INTERRUPTED
        again = capsys.readouterr().err.partition("continue with: ")[2]
        assert again == f"drl-av {' '.join(words)}{last}\n"
    large = ["train", "--preset", "large", "-o", "ppo.decisions=20000", "--seeds", "1,2", "--out"]
    errors = [KeyboardInterrupt(), SimulationError("Killed.")]

    def leave(*arguments: object) -> Iterator[object]:
        folder.mkdir(parents=True)
        (folder / "config.toml").write_text(preset("large").to_toml())
        raise errors.pop(0)
        yield

    monkeypatch.setitem(ENGINES, LOKY, leave)
    for out, status in (("a", INTERRUPTED), ("b", 1)):
        folder = Path(out, "seed-1")
        assert main([*large, out]) == status
        told = f"; move {folder} away, and continue with: drl-av {' '.join(large)} {out}"
        assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("out", "word"), [("idm", "./idm"), ("./-x", "./-x"), ("runs/planner", "runs/planner")]
)
def test_the_printed_word_finds_the_run_and_no_other_driver(
    settings: str, capsys: Capsys, out: str, word: str
) -> None:
    assert main(["train", "--config", settings, "--out", out]) == 0
    assert f"drl-av evaluate {word} idm\n" in capsys.readouterr().out
    assert main(["evaluate", word, "--vehicles", "1", "--episodes", "1"]) == 0
