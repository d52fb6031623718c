"""A scenario folder for each test."""

import shutil
from pathlib import Path

import pytest

from drl_av.scenarios.folder import find_scenario


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A sound scenario folder to spoil."""
    return Path(shutil.copytree(find_scenario(), tmp_path / "scenario"))
