"""No bad input gets through: files cut, flipped and swapped, and command lines of any words.

Each input either means the same as before or is refused in one sentence.
"""

import contextlib
import io
import pickle
import shutil
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, event, example, given, settings
from hypothesis import strategies as st

from drl_av.cli import main
from drl_av.config import Config, from_toml, load_config
from drl_av.drivers.policy_file import load, load_policy
from drl_av.env.highway import HighwayEnv
from drl_av.errors import CheckpointError, ConfigError, ScenarioError, SimulationError
from drl_av.learning.assembly import make_training
from drl_av.learning.checkpoint import save
from drl_av.learning.run import Run
from drl_av.traffic import description_file
from drl_av.traffic.scenario import (
    PlacedVehicle,
    ScenarioDescription,
    find_scenario,
    load_scenario,
    write_scenario,
)

TINY = (
    "[simulation]\ndecisions_per_episode = 2\n[learning]\nepisodes = 2\nevaluation_episodes = 1\n"
)
SMALL = from_toml(TINY + "hidden_units = 4\n[traffic]\nvehicles_max = 3\n")
WORDS = [
    "1",
    "-1",
    "0",
    "3.5",
    "1e400",
    "nan",
    "true",
    "'x'",
    "''",
    "[]",
    "{a=1}",
    "07:32:00",
    "9" * 30,
]
"""TOML values that most settings are not."""


def often(times: int) -> settings:
    """So many examples, slow ones and fixtures that outlive them included."""
    return settings(max_examples=times, deadline=None, suppress_health_check=list(HealthCheck))


def sentence(error: BaseException, names: str = "") -> None:
    """It is one sentence on one line, and names that."""
    text = str(error)
    assert names in text
    assert len(text.splitlines()) == 1, text
    assert text.endswith("."), text


@st.composite
def spoilt(draw: st.DrawFn, data: bytes, *others: bytes) -> bytes:
    """A file cut short, with bits flipped, a piece lost, doubled or changed, or another file."""
    how = draw(st.sampled_from(["cut", "flipped", "lost", "doubled", "changed", "swapped"]))
    event(how)
    if how == "swapped" and others:
        return draw(st.sampled_from(others))
    start, end = sorted(draw(st.tuples(*[st.integers(0, len(data))] * 2)))
    if how == "cut":
        return data[:start]
    if how == "lost":
        return data[:start] + data[end:]
    if how == "doubled":
        return data[:end] + data[start:]
    if how == "changed":
        return data[:start] + draw(st.binary(max_size=20)) + data[start:]
    flipped = bytearray(data)
    for bit in draw(st.lists(st.integers(0, 8 * len(data) - 1), min_size=1, max_size=3)):
        flipped[bit // 8] ^= 1 << bit % 8
    return bytes(flipped)


# Config files

SETTINGS = Config().to_toml()


@st.composite
def odd_settings(draw: st.DrawFn) -> bytes:
    """The settings with one line changed to another value, key or section."""
    lines = SETTINGS.splitlines()
    row = draw(st.integers(0, len(lines) - 1))
    key = lines[row].partition("=")[0].strip()
    value = draw(st.sampled_from(WORDS) | st.floats().map(repr) | st.integers().map(str))
    odd_key = draw(st.sampled_from([key, key, "wings", '"a\\nb"', "learning.seed", "[learning]"]))
    lines[row] = f"{odd_key} = {value}"
    return "\n".join(lines).encode()


@often(150)
@given(text=odd_settings() | spoilt(SETTINGS.encode()) | st.binary())
@example(text=b"a = " + b"[" * 9_000)
@example(text=b"[learning]\nseed = " + b"9" * 9_000)
@example(text=b'["two\\nlines"]')
def test_a_config_file_is_settings_or_one_sentence(text: bytes, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(text)
    try:
        config = load_config(path)
    except ConfigError as error:
        sentence(error, str(path))
    else:
        assert from_toml(config.to_toml()) == config


def test_a_config_file_of_three_gigabytes_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    with path.open("wb") as file:
        file.truncate(3_000_000_000)
    with pytest.raises(ConfigError, match="more than 1000000 characters") as error:
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


# Command lines


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one of everything that a command may be pointed at."""
    folder = tmp_path_factory.mktemp("desk")
    (folder / "tiny.toml").write_text(TINY)
    (folder / "odd.toml").write_text("[learning]\nwings = 2\n")
    (folder / "empty").mkdir()
    shutil.copytree(find_scenario(), folder / "loop")
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        assert main(["train", "--out", "run", *ENOUGH["train"]]) == 0
        assert main(["evaluate", "run", "--out", "rows.csv", *ENOUGH["evaluate"]]) == 0
    return folder


PLACES = [
    "run",
    "loop",
    "empty",
    "tiny.toml",
    "odd.toml",
    "rows.csv",
    "gone",
    "run/policy.safetensors",
]
NUMBERS = ["0", "1", "2", "-1", "x", "1e9", "nan", "", "99999999999999999999"]
OPTIONS = {
    "train": ["--out", "--preset", "--seed", "--replay", "--resume", "--scenario", "--config"],
    "evaluate": ["--driver", "--vehicles", "--seed", "--out", "--json", "--scenario"],
    "replay": ["--driver", "--seed", "--vehicles", "--decisions", "--rate", "--record", "--gui"],
    "scenario": ["--circumference-m", "--lanes", "--lane-width-m", "--barricade"],
    "figures": ["--out"],
}
ENOUGH = {
    "train": ["--config", "tiny.toml"],
    "evaluate": ["--episodes", "1", "--config", "tiny.toml", "--vehicles", "1"],
    "replay": ["--video", "film.gif", "--decisions", "1", "--rate", "9"],
    "scenario": [],
    "figures": [],
}
"""Said last, so that nothing takes long."""
ANY = st.sampled_from([*PLACES, *NUMBERS, "idm", "paper", "papr", "two-buffer", "a\nb", "--", "-x"])


@st.composite
def commands(draw: st.DrawFn) -> list[str]:
    """A verb with options in any order, each with a word that may suit it or not."""
    verb = draw(st.sampled_from(list(OPTIONS)))
    said = draw(st.lists(st.sampled_from(OPTIONS[verb]) | ANY, max_size=5))
    words = [word for option in said for word in (option, *draw(st.lists(ANY, max_size=1)))]
    place = ["--out", draw(st.sampled_from([*PLACES, "new"]))] if verb == "train" else []
    return [verb, *place, *words, *ENOUGH[verb]]


@often(50)
@given(words=commands())
@example(words=["evaluate", "a\nb"])
@example(words=["train", "--out", "new", "--config", "a\nb"])
def test_a_command_line_works_or_says_in_one_line_what_is_wrong(
    words: list[str], desk: Path
) -> None:
    out, err = io.StringIO(), io.StringIO()
    folder = shutil.copytree(desk, desk.with_name("copy"), dirs_exist_ok=True)
    try:
        with (
            contextlib.chdir(folder),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            status: object = main(words)
    except SystemExit as ended:
        status = ended.code
    finally:
        shutil.rmtree(folder)
    event(f"{words[0]}: {status}")
    message = err.getvalue()
    assert "Traceback" not in message
    if status == 2:
        assert message.startswith("usage: drl-av")
    elif status == 1:
        assert message.startswith("drl-av: ")
        assert message.endswith(".\n")
        assert message.count("\n") == 1
    else:
        assert (status, message) == (0, "")


# Scenario folders


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The shipped scenarios and one that places its vehicles."""
    placed = tmp_path_factory.mktemp("roads") / "placed"
    vehicles = PlacedVehicle("ego", 1, 2.0, 20.0, 30.0), PlacedVehicle("slow", 1, 124.9, 10.0, 12.0)
    write_scenario(placed, ScenarioDescription(600.0, vehicles=vehicles))
    return [find_scenario(), find_scenario("barricaded_right_lane"), placed]


def driven(folder: Path) -> bytes:
    """The positions of all vehicles after three decisions."""
    with closing(HighwayEnv(folder, safety_check="permit_all")) as env:
        env.reset(seed=3)
        for action in (1, 8, 8):
            env.step(action)
        return np.stack((env.scene.snapshot.s_m, env.scene.snapshot.y_m)).tobytes()


@often(80)
@given(data=st.data())
def test_a_scenario_folder_is_itself_or_one_sentence(
    data: st.DataObject, roads: list[Path]
) -> None:
    road = data.draw(st.sampled_from(roads))
    folder = Path(shutil.copytree(road, roads[-1].with_name("spoilt")))
    try:
        name = data.draw(st.sampled_from(sorted(path.name for path in folder.iterdir())))
        others = [path.read_bytes() for path in roads[0].parent.glob("*/*")]
        others += [(other / name).read_bytes() for other in roads if (other / name).exists()]
        if data.draw(st.integers(0, 9)):
            (folder / name).write_bytes(data.draw(spoilt((road / name).read_bytes(), *others)))
        else:
            (folder / name).unlink()
        found = driven(folder)
    except ScenarioError as error:
        sentence(error)
    else:
        assert found == driven(road)
    finally:
        shutil.rmtree(folder)


@often(60)
@given(
    text=spoilt(
        ScenarioDescription(vehicles=(PlacedVehicle("ego", 1, 2.0, 20.0, 30.0),)).to_toml().encode()
    )
)
@example(text=b"lanes = " + b"[" * 9_000)
@example(text=b"lanes = " + b"9" * 9_000)
def test_a_description_written_by_hand_is_a_road_or_one_sentence(text: bytes) -> None:
    try:
        found = description_file.from_toml(text.decode(errors="replace"))
    except ScenarioError as error:
        sentence(error)
    else:
        assert description_file.from_toml(found.to_toml()) == found


def test_a_scenario_that_only_sumo_finds_wrong_is_one_sentence(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(find_scenario(), tmp_path / "loop"))
    types = folder / "vehicle_types.add.xml"
    types.write_text(types.read_text().replace('"IDM"', '"IDN"'))
    (folder / "SHA256SUMS").unlink()
    with pytest.raises(SimulationError, match="SUMO cannot load the scenario") as error:
        driven(folder)
    sentence(error.value)
    assert load_scenario(folder)


# Checkpoint and policy files


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
        run, training = Run(tmp_path_factory.mktemp("runs") / "run"), make_training(env)
        run.create(env.config)
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


jsons = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=6,
)


@often(60)
@given(data=st.data())
def test_a_file_with_a_true_checksum_and_false_contents_is_one_sentence(
    data: st.DataObject, env: HighwayEnv, runs: list[Path]
) -> None:
    tensors, numbers = load(Run(runs[0]).checkpoint_file)
    name = data.draw(st.sampled_from([*tensors, *numbers]))
    if name in tensors:
        shape = data.draw(st.sampled_from([(), (0,), (3, 2), tensors[name].shape]))
        tensors[name] = np.zeros(shape, data.draw(st.sampled_from(["f8", "i4", "u1", "?"])))
    else:
        numbers[name] = data.draw(jsons.filter(lambda value: type(value) not in (int, bool)))
    if data.draw(st.booleans()):
        (tensors if name in tensors else numbers).pop(name)
    with to_spoil(env, runs) as run:
        rows = run.episodes_file.read_bytes()
        save(run.checkpoint_file, tensors, numbers)
        for read in (
            lambda: run.restore(make_training(env)),
            lambda: load_policy(run.checkpoint_file),
        ):
            with pytest.raises(CheckpointError) as error:
                read()
            sentence(error.value)
        assert run.episodes_file.read_bytes() == rows


@pytest.mark.parametrize(
    ("name", "place", "value", "message"),
    [
        ("learner.online", 0, np.nan, "'online' holds numbers that are not finite"),
        ("learner.second_moment", 7, np.inf, "'second_moment' holds numbers that are not finite"),
        ("buffer.safe.rows", (0, 3), np.nan, "rows that are no transitions"),
        ("buffer.safe.rows", (0, -3), 12, "rows that are no transitions"),
        ("buffer.safe.rows", (0, -3), 1.5, "rows that are no transitions"),
        ("buffer.safe.rows", (0, -3), -1, "rows that are no transitions"),
        ("buffer.safe.rows", (0, -1), 1.01, "rows that are no transitions"),
    ],
)
def test_a_checkpoint_with_one_impossible_number_is_refused(
    name: str, place: Any, value: float, message: str, env: HighwayEnv, runs: list[Path]
) -> None:
    with to_spoil(env, runs) as run:
        tensors, numbers = load(run.checkpoint_file)
        tensors[name] = tensors[name].copy()
        tensors[name][place] = value
        save(run.checkpoint_file, tensors, numbers)
        with pytest.raises(CheckpointError, match=message) as error:
            run.restore(make_training(env))
        sentence(error.value)


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
        with pytest.raises(CheckpointError, match="does not hold the rows") as error:
            run.restore(make_training(env))
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
        run.restore(make_training(env))
    assert victim.read_text() == "dear diary"


class Bomb:
    """Leaves a mark where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self.mark,)


def test_no_file_runs_code_when_it_is_loaded(
    env: HighwayEnv, runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
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
    runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mixed = Path(shutil.copytree(runs[0], tmp_path / "mixed"))
    shutil.copy(runs[1] / "policy.safetensors", mixed)
    assert main(["evaluate", str(mixed), "--vehicles", "1", "--episodes", "1"]) == 1
    assert "belongs to other settings" in capsys.readouterr().err
    policy = str(mixed / "policy.safetensors")
    assert main(["evaluate", policy, "--vehicles", "1", "--episodes", "1"]) == 0
