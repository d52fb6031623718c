"""Groups of trainings that are compared as one driver, such as ``ppo=runs/seed-*`` (ours)."""

import os
import re
from glob import glob

from drl_av.errors import ConfigError
from drl_av.safety import CHECKS

_GROUP = re.compile(r"([\w.-]+)=(.+)")


def trainings_of(word: str) -> tuple[str, list[str]]:
    """Return the name of the group that a word names, and the words of its trainings.

    A group is ``NAME=PATTERN``, where the pattern matches files and folders as in a shell;
    ``@CHECK`` may follow, which is then a part of the group's name. The trainings are in the order
    of the numbers in their paths. The name is "" for the word of one driver.

    Raises:
        ConfigError: nothing matches the pattern.
    """
    found = _GROUP.fullmatch(word)
    if not found or os.path.exists(word):
        return "", [word]
    name, pattern = found.groups()
    path, at, check = pattern.rpartition("@")
    if not at or check not in CHECKS:
        path, at, check = pattern, "", ""
    paths = [path] if os.path.exists(path) else sorted(glob(path), key=_by_number)
    if not paths:
        raise ConfigError(
            f"No file or folder matches {pattern!r}, which names the trainings of {name}: correct "
            "the pattern."
        )
    return name + at + check, [each + at + check for each in paths]


def _by_number(path: str) -> list[tuple[int, str]]:
    """Return a sort key with which seed-2 comes before seed-10."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", path)]
