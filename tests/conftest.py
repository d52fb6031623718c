"""Puts this folder on the import path, so that every room's tests find ``worlds``."""

import errno
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("drl_av", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=500)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "drl_av"))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip the tests of ray without the extra ``ray``."""
    if item.get_closest_marker("ray") and not find_spec("ray"):
        pytest.skip("needs ray: pip install -e '.[dev,ray]', as make setup does")


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    """Closes after a test what its fixtures have made."""
    with ExitStack() as entered:
        yield entered


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that a test works in: an empty one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """No file can be brought to the disk."""

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)


@pytest.fixture(scope="session")
def screen() -> Iterator[str]:
    """A virtual screen of this session's own."""
    program = shutil.which("Xvfb")
    if program is None:
        pytest.fail("Xvfb is missing: install it with apt-get install xvfb.", pytrace=False)
    reader, writer = os.pipe()
    arguments = [program, "-displayfd", str(writer), "-screen", "0", "1280x900x24"]
    arguments += ["-nolisten", "tcp"]
    with subprocess.Popen(arguments, pass_fds=(writer,), stderr=subprocess.DEVNULL) as server:
        os.close(writer)
        try:
            with os.fdopen(reader) as stream:
                number = stream.readline().strip()
            if not number:
                pytest.fail("Xvfb started, but opened no screen.", pytrace=False)
            yield f":{number}"
        finally:
            server.terminate()
