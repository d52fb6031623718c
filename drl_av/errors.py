"""The errors that the package raises; each message is one sentence: what, where, what to do."""

import unicodedata
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


def pluralize(number: int, noun: str) -> str:
    """Return a number with its noun, which gets an "s" unless the number is 1."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def printable(text: str) -> str:
    """Return a text with escapes for control characters, so that no terminal obeys them."""
    return "".join(
        each if unicodedata.category(each) not in ("Cc", "Cf", "Cs") else ascii(each)[1:-1]
        for each in text
    )


class DrlAvError(Exception):
    """Base class of all errors that a user can correct.

    The command ``drl-av`` prints the message and exits with status 1.
    """


class DrlAvWarning(UserWarning):
    """What a user should know before believing a result; ``drl-av`` prints it in one line."""


def warn(text: str, stacklevel: int = 2) -> None:
    """Give a DrlAvWarning; ``stacklevel`` is as for ``warnings.warn``, called in place of this."""
    warnings.warn(text, DrlAvWarning, stacklevel=stacklevel + 1)


class ConfigError(DrlAvError):
    """A setting is unknown, of the wrong type, or outside its bounds."""


class ScenarioError(DrlAvError):
    """A scenario folder is missing or damaged, or a setting of a scenario is wrong."""


class SimulationError(DrlAvError):
    """SUMO could not start, or ended unexpectedly."""


class DisplayError(SimulationError):
    """sumo-gui cannot open a window, because there is no screen."""


class CheckpointError(DrlAvError):
    """A checkpoint or policy file is incomplete, damaged, or belongs to another configuration."""


class RunError(DrlAvError):
    """A run folder cannot be used, for example because it exists already or holds no run."""


class RecordingError(DrlAvError):
    """A recorded episode is damaged, or its replay deviates from it."""


@contextmanager
def needed_by(
    what: object, package: str, install: str, kind: type[DrlAvError] = DrlAvError
) -> Iterator[None]:
    """Raise an error if an import inside the ``with`` block fails.

    Its sentence names what needs the package, and says how to install it: ``install`` is what
    follows "pip install".
    """
    try:
        yield
    except ImportError as error:
        raise kind(
            f"{what} needs the package {package}, which is not installed: pip install {install}."
        ) from error
