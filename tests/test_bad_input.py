"""No bad input gets through: it is refused in one sentence, and no file of the user is harmed.

Inputs damaged at random are in ``verification.fuzz``; these are the worst by name.
"""

import contextlib
import io
import pickle
import shutil
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import torch
from programs import Bomb
from runs import Capsys, error_message, replace_in

from drl_av.cli import main
from drl_av.config import from_toml, load_config
from drl_av.drivers.policy_file import load, load_policy, save
from drl_av.env.highway import HighwayEnv
from drl_av.errors import CheckpointError, ConfigError, ScenarioError, SimulationError
from drl_av.learning.algorithm_1 import build_training
from drl_av.learning.run_folder import Run
from drl_av.scenarios import road_types
from drl_av.scenarios.folder import find_scenario, load_scenario
from verification.fuzz_driving import positions

TINY = (
    "[simulation]\ndecisions_per_episode = 2\n[learning]\nepisodes = 2\nevaluation_episodes = 1\n"
)
SMALL = from_toml(TINY + "hidden_units = 4\n[traffic]\nvehicles_max = 3\n")


def sentence(error: BaseException, names: str = "") -> None:
    """It is one sentence on one line, and names that."""
    text = str(error)
    assert names in text
    assert len(text.splitlines()) == 1, text
    assert text.endswith("."), text


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (b"a = " + b"[" * 9_000, "is not valid TOML"),
        (b"[learning]\nseed = " + b"9" * 9_000, "is not valid TOML"),
        (b'["two\\nlines"]', r"no section"),
        ("[learning]\nseed = 3\n".encode("utf-16"), "is not UTF-8 text .* save it as UTF-8"),
    ],
    ids=["deep", "long", "two lines", "utf-16"],
)
def test_an_absurd_config_file_is_one_sentence(text: bytes, told: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(text)
    with pytest.raises(ConfigError, match=told) as error:
        load_config(path)
    sentence(error.value, str(path))


def test_a_file_that_windows_wrote_is_read(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf[learning]\r\nseed = 3\r\n")
    assert load_config(path).learning.seed == 3
    folder = Path(shutil.copytree(find_scenario(), tmp_path / "loop"))
    file = folder / "scenario.toml"
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().replace(b"\n", b"\r\n"))
    (folder / "SHA256SUMS").unlink()
    assert load_scenario(folder).description == load_scenario(find_scenario()).description


@pytest.mark.parametrize("words", ["evaluate a\nb", "train --out new --config a\nb"])
def test_a_name_of_two_lines_is_refused_in_one(words: str, here: Path, capsys: Capsys) -> None:
    assert main(words.split(" ")) == 1
    error_message(capsys)


@pytest.mark.parametrize("lanes", ["[" * 9_000, "9" * 9_000], ids=["deep", "long"])
def test_an_absurd_description_is_refused_in_one_sentence(lanes: str) -> None:
    with pytest.raises(ScenarioError) as error:
        road_types.from_toml(f"lanes = {lanes}")
    sentence(error.value)


def test_a_scenario_that_only_sumo_finds_wrong_is_one_sentence(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(find_scenario(), tmp_path / "loop"))
    replace_in(folder / "vehicle_types.add.xml", '"IDM"', '"IDN"', count=-1)
    (folder / "SHA256SUMS").unlink()
    with pytest.raises(SimulationError, match="SUMO cannot load the scenario") as error:
        positions(folder)
    sentence(error.value)
    assert load_scenario(folder)


@pytest.fixture(scope="module")
def env() -> Iterator[HighwayEnv]:
    with closing(HighwayEnv(config=SMALL)) as env:
        yield env


@pytest.fixture(scope="module")
def runs(env: HighwayEnv, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two runs of other seeds, trained for an episode."""
    folders = []
    for seed in (1, 2):
        env.config = SMALL.updated("learning", seed=seed)
        run, training = Run(tmp_path_factory.mktemp("runs") / "run"), build_training(env)
        run.create(training)
        run.append(run.episodes_file, training.run_episode())
        run.save(training)
        folders.append(run.folder)
    return folders


@contextlib.contextmanager
def to_spoil(env: HighwayEnv, runs: list[Path]) -> Iterator[Run]:
    """The first run, whose checkpoint and rows are whole again afterwards."""
    run = Run(runs[0])
    env.config = SMALL.updated("learning", seed=1)
    files = {file: file.read_bytes() for file in (run.checkpoint_file, run.episodes_file)}
    try:
        yield run
    finally:
        for file, data in files.items():
            file.write_bytes(data)


@pytest.mark.parametrize(
    "changed",
    [
        lambda header, row: (header + b"X" * len(row[:-1]) + b"\n", 0),
        lambda header, row: (header + b"2" + row[1:], 0),
        lambda header, row: (header + row, -1),
        lambda header, row: (header + row, -len(row)),
        lambda header, row: (b"E" + header[1:] + row, 0),
        lambda header, row: (b"\x00" * len(header + row), 0),
    ],
    ids=["no row", "another episode", "half a row", "a row less", "another header", "zeros"],
)
def test_a_table_that_is_not_the_checkpoint_s_is_refused_and_stays_as_it_is(
    changed: Callable[[bytes, bytes], tuple[bytes, int]], env: HighwayEnv, runs: list[Path]
) -> None:
    with to_spoil(env, runs) as run:
        held, fewer = changed(*run.episodes_file.read_bytes().splitlines(keepends=True))
        tensors, numbers = load(run.checkpoint_file)
        numbers["sizes"]["episodes.csv"] += fewer
        save(run.checkpoint_file, tensors, numbers)
        run.episodes_file.write_bytes(held)
        with pytest.raises(CheckpointError, match="has lost rows") as error:
            run.restore(build_training(env))
        sentence(error.value)
        assert run.episodes_file.read_bytes() == held


def test_a_checkpoint_truncates_no_file_but_the_run_s_own(
    env: HighwayEnv, runs: list[Path]
) -> None:
    victim = runs[0].parent / "diary.txt"
    victim.write_text("dear diary")
    with to_spoil(env, runs) as run:
        tensors, numbers = load(run.checkpoint_file)
        numbers["sizes"]["../diary.txt"] = 0
        save(run.checkpoint_file, tensors, numbers)
        run.restore(build_training(env))
    assert victim.read_text() == "dear diary"


def test_no_file_runs_code_when_it_is_loaded(
    env: HighwayEnv, runs: list[Path], tmp_path: Path, capsys: Capsys
) -> None:
    mark = tmp_path / "exploded"
    pickle.loads(pickle.dumps(Bomb(mark)))
    assert mark.exists(), "the bomb is a dud"
    mark.unlink()
    torch_file, numpy_file = io.BytesIO(), io.BytesIO()
    torch.save({"bomb": Bomb(mark)}, torch_file)
    np.savez(numpy_file, config=np.array([Bomb(mark)], dtype=object))
    for data in (pickle.dumps(Bomb(mark)), torch_file.getvalue(), numpy_file.getvalue()):
        path = tmp_path / "bomb.npz"
        path.write_bytes(data)
        shutil.copytree(runs[0], tmp_path / "run", dirs_exist_ok=True)
        for name in ("checkpoint.safetensors", "policy.safetensors"):
            (tmp_path / "run" / name).write_bytes(data)
        for words in (
            ["replay", str(path), "--video", str(tmp_path / "film.gif")],
            ["evaluate", str(tmp_path / "run"), "--episodes", "1"],
            ["train", "--out", str(tmp_path / "run"), "--resume"],
        ):
            assert main(words) == 1
            assert capsys.readouterr().err.count("\n") == 1
    assert not mark.exists()


def test_a_policy_of_another_run_is_not_taken_for_this_run_s(
    runs: list[Path], tmp_path: Path, capsys: Capsys
) -> None:
    mixed = Path(shutil.copytree(runs[0], tmp_path / "mixed"))
    shutil.copy(runs[1] / "policy.safetensors", mixed)
    assert main(["evaluate", str(mixed), "--vehicles", "1", "--episodes", "1"]) == 1
    assert "belongs to other settings" in capsys.readouterr().err
    policy = str(mixed / "policy.safetensors")
    assert main(["evaluate", policy, "--vehicles", "1", "--episodes", "1"]) == 0


def test_a_small_policy_file_that_asks_for_huge_networks_gets_none(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    config = SMALL.updated("learning", hidden_units=10_000)
    save(path, {"a": np.zeros(3, np.float32)}, {"kind": "policy", "config": config.to_toml()})
    tracemalloc.start()
    told = "does not fit a network of 27 -> 10000 -> 10000"
    with pytest.raises(CheckpointError, match=told) as error:
        load_policy(path)
    sentence(error.value, str(path))
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()
