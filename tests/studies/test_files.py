"""Result files are written whole, and only over regular files."""

import os
from pathlib import Path

import pytest

from drl_av.errors import DrlAvError
from drl_av.studies.files import require_writable, write_whole


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
