"""Functions of the user, such as a reward: imports them, and checks which arguments they take."""

import hashlib
import importlib.util
import re
import sys
from inspect import signature
from pathlib import Path
from traceback import extract_tb
from typing import Any

from drl_av.errors import ConfigError

_NAME = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


def is_users(part: object) -> bool:
    """Return whether a function, or the class of an object, is not of this package."""
    module = (part if hasattr(part, "__qualname__") else type(part)).__module__ or ""
    return module.partition(".")[0] != __package__.partition(".")[0]


def is_factory(word: str) -> bool:
    """Return whether a word has the form ``module:factory``, which names a function of the user."""
    return _NAME.fullmatch(word) is not None


def import_function(word: str, what: str) -> Any:
    """Import the function ``module:name``; Python searches the working directory first.

    It does so from then on, also for what the function imports when it is called. ``what`` says
    for the error message what the function makes or is, such as "driver".

    Raises:
        ConfigError: the module or the function does not exist, or the module cannot be imported.
    """
    if not is_factory(word):
        raise ConfigError(f"The {what} {word!r} is not the name of a function: write module:name.")
    module, _, name = word.partition(":")
    _search_here_first()
    try:
        return getattr(importlib.import_module(module), name)
    except Exception as error:  # the module is the user's
        raise ConfigError(
            f"The {what} {word!r} cannot be imported ({error}{_place(error)}): write it as "
            "module:name, with a module in the working directory or an installed one that can be "
            "imported."
        ) from error


def _place(error: Exception) -> str:
    """Return the line of an imported module that raised an error; "" if no line of it ran."""
    lines = [each for each in extract_tb(error.__traceback__) if each.filename[:1] not in ("", "<")]
    theirs = [each for each in lines if each.filename not in (__file__, importlib.__file__)]
    return f", line {theirs[-1].lineno} of {theirs[-1].filename}" if theirs else ""


def _search_here_first() -> None:
    """Put the working directory first on Python's path."""
    folder = str(Path.cwd())
    if folder not in sys.path[:1]:
        sys.path.insert(0, folder)


def source_digest(word: str) -> str:
    """Return the SHA-256 of the module's file in ``module:name``, or of all files of its package.

    It is "" without any file.
    """
    _search_here_first()
    found = importlib.util.find_spec(re.split(r"[.:]", word)[0])
    if found is None:
        return ""
    folders = found.submodule_search_locations
    files = [Path(found.origin)] if found.has_location and found.origin else []
    if folders is not None:
        files = sorted(file for folder in folders for file in Path(folder).rglob("*.py"))
    content = b"".join(file.read_bytes() for file in files)
    return hashlib.sha256(content).hexdigest() if files else ""


def require_function(function: Any, what: str, *arguments: str) -> None:
    """Raise ConfigError unless ``function`` can be called with these positional arguments.

    ``what`` is the function's name in the error message; ``arguments`` are the argument names.
    """
    given = ", ".join(arguments)
    if not callable(function):
        raise ConfigError(f"{what} is {function!r}, but must be a function of ({given}).")
    try:
        parameters = signature(function)
    except ValueError:  # some functions of C libraries have no signature
        return
    try:
        parameters.bind(*arguments)
    except TypeError as error:
        name = getattr(function, "__name__", type(function).__name__)
        raise ConfigError(
            f"{what} is called with ({given}), which {name}{parameters} does not take ({error}): "
            "change its arguments."
        ) from error
