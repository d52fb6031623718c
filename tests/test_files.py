"""Result files are written whole, and only over regular files."""

import errno
import os
from pathlib import Path

import pytest

from drl_av.errors import DrlAvError
from drl_av.experiments.drawing import plain_figure, save_figure
from drl_av.files import require_writable, write_whole


def test_a_link_is_written_through_and_stays_a_link(tmp_path: Path) -> None:
    real, link = tmp_path / "real.csv", tmp_path / "link.csv"
    real.write_text("old")
    link.symlink_to(real)
    write_whole(link, b"new")
    assert link.is_symlink()
    assert real.read_text() == "new"


def test_a_pipe_is_refused_and_stays_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(DrlAvError, match="no regular file"):
        require_writable(pipe)
    assert pipe.is_fifo()


def test_nothing_is_left_beside_the_file(tmp_path: Path) -> None:
    require_writable(tmp_path / "new.csv")
    write_whole(tmp_path / "new.csv", b"x")
    assert [path.name for path in tmp_path.iterdir()] == ["new.csv"]


def test_a_link_to_itself_is_written_over(tmp_path: Path) -> None:
    link = tmp_path / "link.csv"
    link.symlink_to(link)
    require_writable(link)
    write_whole(link, b"new")
    assert link.read_text() == "new"


def test_two_names_of_one_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "link.csv").symlink_to(tmp_path / "rows.csv")
    require_writable(tmp_path / "rows.csv", None, tmp_path / "other.csv")
    with pytest.raises(DrlAvError, match="two files at once"):
        require_writable(tmp_path / "rows.csv", tmp_path / "link.csv")


def test_a_figure_that_does_not_fit_on_the_disk_leaves_the_one_of_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "figure.png"
    path.write_text("before")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(DrlAvError, match="No space left on device"):
        save_figure(plain_figure("x", "y")[0], path)
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
