"""Damaged and crafted results: each is refused in one sentence before anything is driven."""

import json
import os
import resource
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from drl_av.env.highway import HighwayEnv
from drl_av.errors import DrlAvError
from drl_av.files import read_table, write_table
from studies.__main__ import main
from studies.experiment import reproduce
from studies.options import ReproduceOptions
from studies.registry import EXPERIMENTS

RESULTS = Path(__file__).parents[2] / "docs" / "results"
Change = Callable[[list[dict[str, str]]], None]


@pytest.fixture(autouse=True)
def _nothing_is_driven(monkeypatch: pytest.MonkeyPatch) -> None:
    def reset(*arguments: Any, **named: Any) -> None:
        raise AssertionError("an episode begins")

    monkeypatch.setattr(HighwayEnv, "reset", reset)


def held(folder: Path) -> dict[str, object]:
    """The files of a folder; of what is no regular file only its kind."""
    return {
        path.name: path.read_bytes() if path.is_file() else path.stat().st_mode >> 12
        for path in folder.iterdir()
    }


def committed(name: str, folder: Path) -> ReproduceOptions:
    """Copy the committed results of an experiment; ask for more of them than there are."""
    folder.mkdir()
    for file in RESULTS.glob(f"{name}.*"):
        shutil.copy(file, folder)
    return ReproduceOptions(seeds=10, drives=101, jobs=1, out=folder, runs=folder / "runs")


def require_refused(name: str, options: ReproduceOptions, message: str = ".") -> None:
    """The experiment is refused in one sentence that says what to do, and no file changes."""
    before = held(options.out)
    with pytest.raises(DrlAvError, match=message) as error:
        next(reproduce(EXPERIMENTS[name], options))
    text = str(error.value)
    assert str(options.out) in text
    assert text.count("\n") == 0
    assert text.endswith(".")
    assert any(f" {verb} " in text for verb in ("put", "choose", "name")), text
    assert held(options.out) == before


def cell(line: int, column: str, value: str) -> Change:
    def change(rows: list[dict[str, str]]) -> None:
        rows[line - 2][column] = value

    return change


def doubled(rows: list[dict[str, str]]) -> None:
    rows.append(rows[3])


def lost(rows: list[dict[str, str]]) -> None:
    del rows[3]


DRIVES = ("density_sweep", "final_policies")
"""Drivers that exist, and drivers that are trained first."""
NUMBER = {**dict.fromkeys(DRIVES, "mean_speed_m_s"), "curves": "training_reward"}
NUMBER["barricade"] = "decisions"
"""An experiment of each kind of cell, and a column of numbers."""
NAME = {"density_sweep": "driver", "final_policies": "training", "curves": "variant"}
NAME |= {"opponents": "driver", "real_bounds": "bounds", "strict": "check", "barricade": "phase"}
"""A column of names of each experiment with an order of rows of its own."""
LOST = "a seed is missing|lacks a row|rows of a training|did not drive the same traffic"
STORIES = [
    *(
        (name, cell(5, column, value), f"line 5: {column} is|{column} is")
        for name, column in NUMBER.items()
        for value in ("nan", "fast")
    ),
    *(
        ("exact_speed", cell(5, "mean_speed_m_s", value), "line 5: mean_speed_m_s is")
        for value in ("inf", "-1e999", "1e300", "", "9" * 400)
    ),
    *((name, cell(6, column, "mine-7"), "damaged") for name, column in NAME.items()),
    *((name, doubled, "is there twice|lacks a row|rows of a training") for name in NUMBER),
    *((name, lost, LOST) for name in NUMBER),
    *((name, cell(2, "vehicles", "7"), "damaged") for name in DRIVES),
    *((name, cell(4, "seed", "-3"), "damaged") for name in DRIVES),
    *((name, cell(4, "vehicles", "1.0"), "damaged") for name in DRIVES),
    *((name, cell(3, "ego_hit", "maybe"), "ego_hit is maybe") for name in DRIVES),
    ("curves", cell(3, "episode", "150"), "lacks a row before"),
    ("barricade", cell(3, "seed", "5"), "damaged"),
    ("barricade", cell(3, "episode", "900"), "rows of a training"),
    ("density_sweep", cell(4400, "vehicles", "41"), "vehicles is 41"),
]


@pytest.mark.parametrize(("name", "change", "message"), STORIES)
def test_rows_that_no_experiment_makes_are_refused_before_hours_are_driven(
    name: str, change: Change, message: str, tmp_path: Path
) -> None:
    options = committed(name, tmp_path / "out")
    table = options.out / f"{name}.csv"
    rows = read_table(table)
    change(rows)
    write_table(table, rows[0], rows)
    require_refused(name, options, message)


@pytest.mark.parametrize("name", ["final_policies", "curves"])
@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"seed\n",
        b"\xff\xfe\x00seed\n0\n",
        b"a,b\n1,2\n",
        (RESULTS / "barricade.csv").read_bytes(),
        (RESULTS / "paired.csv").read_bytes(),
        b"x" * 200_000,
        b"\0" * 5000 + b"\n",
    ],
    ids=["empty", "header", "UTF-16", "two columns", "barricade", "paired", "one line", "zeros"],
)
def test_a_table_of_something_else_is_refused(data: bytes, name: str, tmp_path: Path) -> None:
    options = committed(name, tmp_path / "out")
    (options.out / f"{name}.csv").write_bytes(data)
    require_refused(name, options)


def test_a_last_row_that_is_cut_short_is_refused(tmp_path: Path) -> None:
    options = committed("exact_speed", tmp_path / "out")
    table = options.out / "exact_speed.csv"
    table.write_bytes(table.read_bytes()[:-4])
    require_refused("exact_speed", options, "line 701 is cut short")


def test_a_table_that_windows_wrote_is_read(tmp_path: Path) -> None:
    options = committed("exact_speed", tmp_path / "out")._replace(drives=100)
    for name in ("exact_speed.csv", "exact_speed.json"):
        file = options.out / name
        file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().replace(b"\n", b"\r\n"))
    before = held(options.out)
    assert list(reproduce(EXPERIMENTS["exact_speed"], options)) == []
    assert held(options.out) == before


def without(*names: str) -> Callable[[dict[str, Any]], object]:
    return lambda facts: {name: value for name, value in facts.items() if name not in names}


def setting(name: str, value: object) -> Callable[[dict[str, Any]], object]:
    return lambda facts: facts | {name: value}


@pytest.mark.parametrize("name", ["density_sweep", "final_policies", "curves"])
@pytest.mark.parametrize(
    "change",
    [
        lambda facts: {},
        lambda facts: [facts],
        lambda facts: "facts",
        lambda facts: 7,
        without("settings"),
        without("wall_time_s"),
        setting("settings", {}),
        setting("settings", {"paper": 5}),
        setting("settings", {"paper": {"wings": {"number": 2}}}),
        setting("settings", {"simulation": {"step_length_s": float("nan")}}),
        setting("wall_time_s", float("inf")),
        setting("wall_time_s", -1.0),
        setting("wall_time_s", {"paper-0": "long"}),
        lambda facts: json.loads((RESULTS / "barricade.json").read_text()),
        lambda facts: json.loads((RESULTS / "adaptation.json").read_text()),
    ],
)
def test_a_provenance_that_is_not_the_table_s_is_refused(
    change: Callable[[dict[str, Any]], object], name: str, tmp_path: Path
) -> None:
    options = committed(name, tmp_path / "out")
    file = options.out / f"{name}.json"
    file.write_text(json.dumps(change(json.loads(file.read_text()))))
    require_refused(name, options)


@pytest.mark.parametrize(
    "text",
    ["", "{", "[" * 100_000, '{"settings": ' * 50_000, "\0", '{"settings": ' + "9" * 5000 + "}"],
    ids=["empty", "cut", "deep list", "deep object", "zero", "long number"],
)
def test_a_provenance_that_is_no_json_is_refused(text: str, tmp_path: Path) -> None:
    options = committed("exact_speed", tmp_path / "out")
    (options.out / "exact_speed.json").write_text(text)
    require_refused("exact_speed", options, "put")


def test_a_provenance_of_65_megabytes_is_refused(tmp_path: Path) -> None:
    options = committed("exact_speed", tmp_path / "out")
    with (options.out / "exact_speed.json").open("ab") as file:
        file.truncate(65_000_000)
    require_refused("exact_speed", options, "larger than 64 MB")


@pytest.mark.skipif(os.name == "nt", reason="named pipes")
@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo], ids=["folder", "pipe"])
@pytest.mark.parametrize("file", ["curves.csv", "curves.json", "convergence.csv"])
def test_a_folder_or_pipe_in_place_of_a_file_is_refused(
    file: str, make: Callable[[Path], None], tmp_path: Path
) -> None:
    options = committed("curves", tmp_path / "out")
    (options.out / file).unlink(missing_ok=True)
    make(options.out / file)
    require_refused("curves", options, f"{file} (is a folder|exists and is no regular file)")


def test_a_folder_in_place_of_a_figure_is_refused_before_it_is_drawn(tmp_path: Path) -> None:
    options = committed("density_sweep", tmp_path / "out")
    (options.out / "mean_speed.png").mkdir()
    require_refused("density_sweep", options, r"mean_speed\.png is a folder: name a file")


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Let no file grow beyond the size, as on a disk that is almost full."""
    former = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, former[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, former)


@pytest.mark.parametrize("size", [0, 1000, 50_000])
def test_a_disk_without_room_for_the_table_is_found_before_anything_is_driven(
    size: int, tmp_path: Path
) -> None:
    options = committed("exact_speed", tmp_path / "out")  # the table has 117 kB
    with largest_file(size):
        require_refused("exact_speed", options, r"exact_speed\.csv cannot be written .*: free some")


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_must_not_be_written_to_is_refused(tmp_path: Path) -> None:
    options = committed("exact_speed", tmp_path / "out")
    options.out.chmod(0o500)
    require_refused("exact_speed", options, "cannot be written")


@pytest.mark.parametrize("option", ["--out", "--runs"])
def test_a_file_in_place_of_a_folder_is_one_sentence(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    folders = {"--out": tmp_path / "out", "--runs": tmp_path / "runs", option: tmp_path / "file"}
    words = [word for name, folder in folders.items() for word in (name, str(folder))]
    assert main(["curves", "--seeds", "1", "--jobs", "1", *words]) == 1
    message = capsys.readouterr().err
    assert message == (
        f"drl-av: The folder {tmp_path / 'file'} cannot be made (File exists): "
        f"choose another one with {option}.\n"
    )
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("name", ["real_bounds", "curves", "final_policies"])
def test_results_of_more_seeds_and_episodes_than_asked_for_are_kept(
    name: str, tmp_path: Path
) -> None:
    options = committed(name, tmp_path / "out")._replace(seeds=2, drives=2)
    before = (options.out / f"{name}.csv").read_bytes()
    assert not any(step.label for step in reproduce(EXPERIMENTS[name], options))
    assert (options.out / f"{name}.csv").read_bytes() == before
