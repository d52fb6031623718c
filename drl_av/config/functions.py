"""Checks that functions of the user, such as a reward, can be called with the right arguments."""

from inspect import signature
from typing import Any

from drl_av.errors import ConfigError


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
