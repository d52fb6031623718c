"""A table of results on disk: rows are added, never replaced; what is damaged is refused."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from drives import episode
from programs import python

from drl_av.config import Config
from drl_av.env.metrics import EpisodeResult
from drl_av.errors import DrlAvError
from drl_av.evaluation import table as module
from drl_av.evaluation.table import Inputs, ResultTable, read_rows, results_of
from drl_av.files.table import Row
from studies.options import order_by

CONFIG = Config()
INPUTS = Inputs({"": CONFIG}, {"mine": "abc"})
PLACE = order_by(vehicles=(1, 5), seed=int, driver=("mine", "idm"))


def row(vehicles: int, seed: int, driver: str = "idm", speed_m_s: float = 20.5) -> Row:
    cells = {"driver": driver, "vehicles": vehicles, "seed": seed, "mean_speed_m_s": speed_m_s}
    return {name: str(value) for name, value in cells.items()}


ROWS = [row(1, 0, "mine"), row(1, 0), row(1, 1, "mine"), row(1, 1), row(5, 0, "mine")]


def opened(folder: Path, inputs: Inputs = INPUTS) -> ResultTable:
    return ResultTable(folder / "rows.csv", inputs, PLACE)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    """A folder with the table of ``ROWS``."""
    table = opened(tmp_path)
    table.add(*ROWS)
    table.seconds[""] = 3.25
    table.save(engine="loky", processes=2)
    return tmp_path


def held(folder: Path) -> dict[str, object]:
    """The files of a folder; of what is no regular file only its kind."""
    return {
        path.name: path.read_bytes() if path.is_file() else path.stat().st_mode >> 12
        for path in folder.iterdir()
    }


def require_refused(folder: Path, message: str = ".", inputs: Inputs = INPUTS) -> None:
    """The table is refused in one sentence that says what to do, and no file changes."""
    before = held(folder)
    with pytest.raises(DrlAvError, match=message) as error:
        opened(folder, inputs)
    text = str(error.value)
    assert str(folder) in text
    assert text.count("\n") == 0
    assert text.endswith(".")
    assert any(f" {verb} " in text for verb in ("put", "choose", "name", "free", "move")), text
    assert held(folder) == before


def test_rows_stand_in_their_order_and_one_that_is_there_stays(saved: Path) -> None:
    table = opened(saved)
    assert row(5, 0, "mine", 99.0) in table
    assert row(5, 0) not in table
    assert not table.add(row(5, 0, "mine", 99.0))
    assert table.add(row(5, 0), row(1, 0, "idm", 99.0))
    assert table.rows == [*ROWS, row(5, 0)]
    assert table.of({"vehicles": "5"}) == [row(5, 0, "mine"), row(5, 0)]
    table.save()
    assert read_rows(saved / "rows.csv") == [*ROWS, row(5, 0)]


def test_the_provenance_says_what_made_the_rows_and_times_add_up(saved: Path) -> None:
    facts = json.loads((saved / "rows.json").read_text())
    assert (facts["engine"], facts["processes"], facts["seeds"]) == ("loky", 2, "0 to 1")
    assert (facts["wall_time_s"], facts["policies_sha256"]) == (3.2, {"mine": "abc"})
    assert facts["settings"]["safety"]["check"] == CONFIG.safety.check
    assert {"command", "date", "eclipse-sumo", "machine", "integration"} <= facts.keys()
    assert opened(saved).seconds == {"": 3.2}
    old = facts | {"eclipse-sumo": "1.20.0", "command": "then"}
    (saved / "rows.json").write_text(json.dumps(old))
    for _ in range(2):  # what made the former rows is named, once
        table = opened(saved)
        table.add(row(5, 9))
        table.save()
    facts = json.loads((saved / "rows.json").read_text())
    assert facts["seeds"] == "0 to 1, 9 to 9"
    [before] = facts["before"]
    assert (before["eclipse-sumo"], before["command"]) == ("1.20.0", "then")


@pytest.mark.parametrize(
    "inputs",
    [
        Inputs({"": CONFIG.updated("safety", check="strict")}),
        Inputs({"": CONFIG}, {"mine": "another"}),
        Inputs({"mine": CONFIG}, {"mine": "abc"}),
    ],
    ids=["config", "driver", "named settings"],
)
def test_rows_of_other_settings_or_drivers_are_not_mixed(inputs: Inputs, saved: Path) -> None:
    require_refused(saved, "was made with other settings, columns or drivers", inputs)


def test_a_row_of_other_columns_is_not_added(saved: Path) -> None:
    table = opened(saved)
    with pytest.raises(DrlAvError, match=r"or drivers \(column collided, only here\): choose"):
        table.add({**row(5, 1), "collided": "False"})


def test_further_drivers_join(saved: Path) -> None:
    table = opened(saved, Inputs({"": CONFIG}, {"further": "def"}))
    table.save()
    facts = json.loads((saved / "rows.json").read_text())
    assert facts["policies_sha256"] == {"mine": "abc", "further": "def"}
    rules = saved / "rules"
    for driver, inputs in (("idm", Inputs({"": CONFIG})), ("mine", INPUTS)):
        table = opened(rules, inputs)
        table.add(row(1, 0, driver))
        table.save()
    require_refused(rules, r"drivers \(mine\)", Inputs({"": CONFIG}, {"mine": "another"}))


def test_a_full_disk_leaves_what_the_next_attempt_continues(
    saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: object) -> None:
        raise DrlAvError("rows.csv cannot be written (No space left on device): free some.")

    table = opened(saved)
    table.add(row(5, 1))
    with monkeypatch.context() as patch:
        patch.setattr(module, "write_table", full)
        with pytest.raises(DrlAvError, match="No space left"):
            table.save()
    assert opened(saved).rows == ROWS


DAMAGED = {
    "twice": (lambda text: text + text.splitlines()[-1] + "\n", "is there twice"),
    "not a number": (lambda text: text.replace("20.5", "fast", 1), "2: mean_speed_m_s is f"),
    "infinite": (lambda text: text.replace("20.5", "-1e999", 1), "mean_speed_m_s is -1e999"),
    "too long": (lambda text: text.replace("20.5", "9" * 400, 1), "mean_speed_m_s is 999"),
    "no driver of it": (lambda text: text.replace("mine", "yours", 1), "damaged"),
    "vehicles": (lambda text: text.replace(",5,", ",7,"), "damaged"),
    "cut short": (lambda text: text[:-3], "line 6 is cut short"),
    "empty": (lambda text: "", "."),
    "header alone": (lambda text: text.splitlines()[0] + "\n", "has no rows"),
    "another table": (lambda text: "a,b\n1,2\n", "damaged"),
}


@pytest.mark.parametrize("how", DAMAGED)
def test_a_damaged_table_is_refused(how: str, saved: Path) -> None:
    change, message = DAMAGED[how]
    text = (saved / "rows.csv").read_text()
    (saved / "rows.csv").write_text(change(text))
    assert (saved / "rows.csv").read_text() != text
    require_refused(saved, message)


def test_a_provenance_without_its_table_is_no_history(saved: Path) -> None:
    (saved / "rows.csv").unlink()
    table = ResultTable(saved / "rows.csv", Inputs({"": CONFIG.with_traffic("hazards")}), PLACE)
    assert table.rows == []
    assert sum(table.seconds.values()) == 0.0


def test_a_table_that_windows_wrote_is_read(saved: Path) -> None:
    for name in ("rows.csv", "rows.json"):
        file = saved / name
        file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().replace(b"\n", b"\r\n"))
    assert opened(saved).rows == ROWS


@pytest.mark.parametrize(
    "changed",
    [
        *({"settings": {}}, {"settings": {"paper": 5}}),
        {"settings": {"paper": {"wings": {"number": 2}}}},
        {"settings": {"simulation": {"step_length_s": float("nan")}}},
        *({"policies_sha256": 7}, {"custom": 7}, {"before": 7}),
        *({"wall_time_s": float("inf")}, {"wall_time_s": -1.0}),
        {"wall_time_s": {"paper-0": "long"}},
        *({"settings": "lost"}, {"wall_time_s": "lost"}),
    ],
)
def test_a_provenance_that_is_not_the_table_s_is_refused(
    changed: dict[str, object], saved: Path
) -> None:
    file = saved / "rows.json"
    facts = json.loads(file.read_text()) | changed
    file.write_text(json.dumps({name: fact for name, fact in facts.items() if fact != "lost"}))
    require_refused(saved)


NO_JSON = {
    "empty": "",
    "cut": "{",
    "deep list": "[" * 100_000,
    "deep object": '{"settings": ' * 50_000,
    "zero": "\0",
    "long number": '{"settings": ' + "9" * 5000 + "}",
    "no facts": "{}",
    "a list": "[{}]",
    "a text": '"facts"',
}


@pytest.mark.parametrize("text", NO_JSON.values(), ids=NO_JSON)
def test_a_provenance_that_is_no_json_of_facts_is_refused(text: str, saved: Path) -> None:
    (saved / "rows.json").write_text(text)
    require_refused(saved, "put")


def test_a_provenance_that_is_lost_is_refused(saved: Path) -> None:
    (saved / "rows.json").unlink()
    require_refused(saved, r"rows\.csv has no rows\.json beside it")


@pytest.mark.skipif(os.name == "nt", reason="named pipes")
@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo], ids=["folder", "pipe"])
@pytest.mark.parametrize("file", ["rows.csv", "rows.json"])
def test_a_folder_or_pipe_in_place_of_a_file_is_refused(
    file: str, make: Callable[[Path], None], saved: Path
) -> None:
    (saved / file).unlink()
    make(saved / file)
    require_refused(saved, f"{file} (is a folder|exists and is no regular file)")


def test_rows_become_results_again_to_the_digit() -> None:
    result = episode("idm", 7, 0.1 + 0.2, mean_reward=-1 / 3, collided=True, way="exit taken")
    text = {name: str(value) for name, value in result.cells().items()}
    assert results_of([text], EpisodeResult) == [result]
    with pytest.raises(ValueError, match="maybe"):
        results_of([text | {"ego_hit": "maybe"}], EpisodeResult)


def test_a_second_process_may_not_write_to_the_table(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    table = ResultTable(path, INPUTS, PLACE)
    ResultTable(path, INPUTS, PLACE)  # the same process may
    program = f"import pathlib, drl_av.files.atomic as f; f.hold(pathlib.Path({str(path)!r}))"
    second = python("-c", program)
    assert second.returncode == 1
    assert f"Another process is writing to {path}: wait for it" in second.stderr
    free = program.replace("t.csv", "u.csv")
    assert python("-c", free).returncode == 0
    nowhere = "import tempfile; tempfile._candidate_tempdir_list = list; "
    assert python("-c", nowhere + free).returncode == 0  # without a lock
    table.add(*ROWS)
    table.save()
    assert python("-c", program).returncode == 1  # though the file is another one now
    path.replace(tmp_path / "before.csv")
    path.write_bytes((tmp_path / "before.csv").read_bytes())  # as one on another machine would
    with pytest.raises(DrlAvError, match=r"changed by another process .* give the same command"):
        table.save()
