"""Inputs of ``verification.fuzz`` that need a trained run: checkpoints and command lines.

They use the *desk*, a folder with a run, a scenario, config files, a table and an empty folder.
"""

import atexit
import contextlib
import io
import random
import shutil
import tempfile
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from drl_av.cli import main
from drl_av.drivers.policy_file import load, save
from drl_av.env.highway import HighwayEnv
from drl_av.learning.algorithm_1 import build_training
from drl_av.learning.run_folder import Run
from drl_av.scenarios.folder import find_scenario

TINY = """
[simulation]
decisions_per_episode = 2
[traffic]
vehicles_max = 3
[learning]
episodes = 2
evaluation_episodes = 1
hidden_units = 4
"""
FALSE: tuple[Any, ...] = (None, [], {}, {"a": 1}, "x", "9" * 5000, 0.5, 1e300, [[0.5, "x"], {}])
"""JSON values that are wrong for every number of a checkpoint."""
FILES = ("run", "loop", "empty", "tiny.toml", "odd.toml", "rows.csv", "gone")
PLACES = (*FILES, "run/policy.safetensors", "/dev/null")
OPTIONS = {
    "train": ("--out", "--preset", "--seed", "--replay", "--resume", "--scenario", "--config"),
    "evaluate": ("--driver", "--vehicles", "--seed", "--out", "--json", "--scenario"),
    "replay": ("--driver", "--seed", "--vehicles", "--decisions", "--rate", "--record", "--gui"),
    "scenario": ("--circumference-m", "--lanes", "--lane-width-m", "--barricade"),
    "figures": ("--out", "--config", "--nonsense"),
    "config": ("--preset", "--out", "learning", "traffic"),
    "nonsense": ("--seed",),
}
ENOUGH = {
    "train": ("--config", "tiny.toml"),
    "evaluate": ("--episodes", "1", "--config", "tiny.toml", "--vehicles", "1"),
    "replay": ("--video", "film.gif", "--decisions", "1", "--rate", "9"),
}
"""The last arguments of each command line, by verb, so that no command takes long."""
ANY = (
    *PLACES,
    *("0", "1", "2", "-1", "x", "1e9", "1e999", "nan", "", "9" * 20, "a\nb", "--", "-x"),
    *("idm", "paper", "papr", "two-buffer"),
)


@cache
def desk() -> Path:
    """Return the desk, which the first call creates; it is deleted when Python exits."""
    home = tempfile.TemporaryDirectory()
    atexit.register(home.cleanup)
    folder = Path(home.name)
    (folder / "tiny.toml").write_text(TINY)
    (folder / "odd.toml").write_text("[learning]\nwings = 2\n")
    (folder / "empty").mkdir()
    shutil.copytree(find_scenario(), folder / "loop")
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        assert main(["train", "--out", "run", *ENOUGH["train"]]) == 0
        assert main(["evaluate", "run", "--out", "rows.csv", *ENOUGH["evaluate"]]) == 0
    return folder


def checkpoint(rng: random.Random, folder: Path) -> None:
    """Restore a run from a checkpoint with a valid checksum, in most cases with false contents.

    Raises AssertionError if the run accepts false contents or changes its table of episodes.
    """
    run = Run(Path(shutil.copytree(desk() / "run", folder / "run")))
    tensors, numbers = load(run.checkpoint_file)
    name = rng.choice([*tensors, *numbers])
    is_false = rng.random() < 0.8
    if is_false and rng.random() < 0.3:
        (tensors if name in tensors else numbers).pop(name)
    elif is_false and name in tensors:
        shape = rng.choice(((), (0,), (3, 2), tensors[name].shape))
        tensors[name] = np.zeros(shape, rng.choice(("f8", "i4", "u1", "?")))
    elif is_false:
        numbers[name] = rng.choice(FALSE)
    save(run.checkpoint_file, tensors, numbers)
    rows = run.episodes_file.read_bytes()
    try:
        with closing(HighwayEnv(config=run.read_config())) as env:
            run.restore(build_training(env))
    finally:
        assert run.episodes_file.read_bytes() == rows
    assert not is_false, f"it takes a false {name}"


def command_line(rng: random.Random, folder: Path) -> None:
    """Run ``drl-av`` with a random verb, random options, and values that often do not fit."""
    verb = rng.choice(list(OPTIONS))
    words = [verb]
    if verb == "train":
        words += ["--out", rng.choice((*PLACES, "new"))]
    for _ in range(rng.randint(0, 5)):
        words.append(rng.choice(rng.choice((OPTIONS[verb], ANY))))
        words += rng.choices(ANY, k=rng.randint(0, 1))
    shutil.copytree(desk(), folder, dirs_exist_ok=True)
    with contextlib.chdir(folder):
        require_answer([*words, *ENOUGH.get(verb, ())])


def require_answer(words: list[str]) -> None:
    """Run ``drl-av`` with these words; raise AssertionError if its answer is bad.

    A good answer is status 0 without an error message, 1 with one sentence, or 2 with the usage.
    """
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status: Any = main(words)
        except SystemExit as ended:
            status = ended.code
    said = err.getvalue()
    if status == 2:
        assert said.startswith("usage: drl-av"), (words, said)
        assert "Traceback" not in said, (words, said)
    elif status == 1:
        is_sentence = said.startswith("drl-av: ") and said.endswith(".\n") and said.count("\n") == 1
        assert is_sentence, (words, said)
    else:
        assert (status, said) == (0, ""), words
