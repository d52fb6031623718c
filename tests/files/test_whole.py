"""Files and folders appear whole or not at all, and only over regular files."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from programs import python
from runs import disk_tape

from drl_av.errors import DrlAvError, RecordingError
from drl_av.evaluation.figure_style import one_panel, save_figure
from drl_av.files.atomic import replacing, require_suffix, require_writable, write_atomic


def test_a_link_is_written_through_and_stays_a_link(tmp_path: Path) -> None:
    real, link = tmp_path / "real.csv", tmp_path / "link.csv"
    real.write_text("old")
    link.symlink_to(real)
    write_atomic(link, b"new")
    assert link.is_symlink()
    assert real.read_text() == "new"


def test_a_pipe_is_refused_and_stays_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(DrlAvError, match="no regular file"):
        require_writable(pipe)
    assert pipe.is_fifo()


def test_a_link_to_itself_is_written_over(tmp_path: Path) -> None:
    link = tmp_path / "link.csv"
    link.symlink_to(link)
    require_writable(link)
    write_atomic(link, b"new")
    assert link.read_text() == "new"


def test_two_names_of_one_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "link.csv").symlink_to(tmp_path / "rows.csv")
    require_writable(tmp_path / "rows.csv", None, tmp_path / "other.csv")
    with pytest.raises(DrlAvError, match="two files at once"):
        require_writable(tmp_path / "rows.csv", tmp_path / "link.csv")


def test_a_figure_that_does_not_fit_on_the_disk_leaves_the_one_of_before(
    tmp_path: Path, full_disk: None
) -> None:
    path = tmp_path / "figure.png"
    path.write_text("before")
    with pytest.raises(DrlAvError, match="No space left on device"):
        save_figure(one_panel("x", "y")[0], path)
    assert path.read_text() == "before"


@pytest.mark.parametrize("name", ["policy.safetensors", "evaluations.csv", "config.toml"])
def test_nothing_is_written_over_what_belongs_to_a_run(tmp_path: Path, name: str) -> None:
    run, elsewhere = tmp_path / "run", tmp_path / "elsewhere"
    for folder in (run, elsewhere):
        folder.mkdir()
        (folder / "evaluations.csv").write_text("mine")
    require_writable(run / name, elsewhere / "evaluations.csv")  # no run yet
    for own in ("config.toml", name):
        (run / own).write_text("the run's")
    with pytest.raises(DrlAvError, match="belongs to the run in that folder: name another file"):
        require_writable(run / name)
    (tmp_path / "link").symlink_to(run / name)
    with pytest.raises(DrlAvError, match="belongs to the run"):
        require_writable(tmp_path / "link")
    require_writable(run / "table.csv", elsewhere / "evaluations.csv")


def test_the_file_is_on_the_disk_before_it_has_its_name_and_its_name_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tape = disk_tape(monkeypatch)
    write_atomic(tmp_path / "rows.csv", b"x")
    assert tape == ["fsync rows.csv", "rename rows.csv to rows.csv", f"fsync {tmp_path.name}"]


def test_a_folder_appears_with_all_its_files(tmp_path: Path) -> None:
    place = tmp_path / "run"
    place.mkdir()  # an empty one may be there
    with replacing(place) as unfinished:
        (unfinished / "deep").mkdir(parents=True)
        (unfinished / "deep" / "file").write_text("in it")
        assert list(place.iterdir()) == []
    assert (place / "deep" / "file").read_text() == "in it"
    assert list(tmp_path.iterdir()) == [place]


def test_the_folder_of_the_process_is_not_replaced(here: Path) -> None:
    with pytest.raises(DrlAvError, match=r"You are in the folder .*: name a new one in it"):
        replacing(Path()).__enter__()


def test_a_folder_with_files_in_it_is_never_replaced(tmp_path: Path) -> None:
    place = tmp_path / "run"
    place.mkdir()
    (place / "mine").write_text("kept")
    with (
        pytest.raises(DrlAvError, match="made meanwhile, with files in it: choose another"),
        replacing(place) as unfinished,
    ):
        unfinished.mkdir()
    assert (place / "mine").read_text() == "kept"
    assert list(tmp_path.iterdir()) == [place]


@pytest.mark.parametrize("folder", [False, True])
def test_a_block_that_raises_leaves_what_was_there_before(tmp_path: Path, folder: bool) -> None:
    place = tmp_path / "rows.csv"
    if not folder:
        place.write_text("before")

    def broken() -> None:
        with replacing(place) as unfinished:
            if folder:
                unfinished.mkdir()
            else:
                unfinished.write_text("half")
            raise KeyError("driver")

    with pytest.raises(KeyError, match="driver"):
        broken()
    assert [path.read_text() for path in tmp_path.iterdir()] == ([] if folder else ["before"])


def test_a_refusal_is_the_error_that_was_asked_for_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"gone/x cannot be written \(No such file") as message:
        write_atomic(tmp_path / "gone" / "x", b"", RecordingError)
    assert str(message.value).endswith("what was there before is unchanged.")


def test_what_a_dead_process_left_is_removed_and_what_a_living_one_writes_stays(
    tmp_path: Path,
) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    abandoned = tmp_path / f".rows.{process.pid}.k2_x.unfinished.csv"
    abandoned.mkdir()
    (abandoned / "rows.csv").write_text("half")
    folder = tmp_path / f".run.{process.pid}.unfinished"
    folder.mkdir()
    (folder / "file").write_text("half")
    kept = [
        tmp_path / f".rows.{os.getppid()}.unfinished.csv",  # of a process that runs
        tmp_path / f".other.{process.pid}.unfinished.csv",  # of another table
        tmp_path / f".rows.{process.pid}.csv",
        tmp_path / ".rows.mine.unfinished.csv",
    ]
    for path in kept:
        path.write_text("not yours")
    write_atomic(tmp_path / "rows.csv", b"x")
    assert set(tmp_path.iterdir()) == {tmp_path / "rows.csv", folder, *kept}
    with replacing(tmp_path / "run") as unfinished:
        unfinished.mkdir()
    assert set(tmp_path.iterdir()) == {tmp_path / "rows.csv", tmp_path / "run", *kept}


def test_what_is_unfinished_is_for_its_user_alone_and_the_file_for_all(tmp_path: Path) -> None:
    usual = tmp_path / "usual"
    usual.touch()
    with replacing(tmp_path / "rows.csv") as unfinished:
        unfinished.write_text("x")
        assert unfinished.parent.stat().st_mode & 0o777 == 0o700
    assert (tmp_path / "rows.csv").stat().st_mode == usual.stat().st_mode
    usual.chmod(0o640)
    write_atomic(usual, b"again")
    assert usual.stat().st_mode & 0o777 == 0o640


KILLED = """
import os, signal, sys
from collections.abc import Callable
from pathlib import Path
from drl_av.files.atomic import replacing
with replacing(Path(sys.argv[1])) as unfinished:
    unfinished.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_next_writer_clears_up_after_one_that_was_killed(tmp_path: Path) -> None:
    path = tmp_path / "[rows].csv"
    path.write_text("before")
    python("-c", KILLED, path)
    assert path.read_text() == "before"
    assert len(list(tmp_path.iterdir())) == 2
    write_atomic(path, b"new")
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "new"


def test_a_file_of_another_kind_is_not_written_over(tmp_path: Path) -> None:
    require_suffix(tmp_path / "PAGE.HTML", ".html")
    with pytest.raises(DrlAvError, match=r"mod\.py must end with \.html: choose another name"):
        require_suffix(tmp_path / "mod.py", ".html")
