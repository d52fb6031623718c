"""Options, error sentences and provenance that the programs of this folder share."""

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from drl_av.cli.console import exit_status
from drl_av.cli.options import driver_words, int_at_least
from drl_av.config import Config
from drl_av.config.functions import is_factory
from drl_av.config.section import did_you_mean
from drl_av.evaluation.provenance import PACKAGES, provenance


class Program(argparse.ArgumentParser):
    """The command line of a program, with the docstring of its module as help."""

    def __init__(self, doc: str | None) -> None:
        super().__init__(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
        self._begun_s = time.monotonic()

    def number(self, name: str, default: int, meaning: str = "", low: int = 1) -> None:
        """Add an option for a whole number, at least ``low``; its help shows ``meaning``."""
        self.add_argument(name, type=int_at_least(low), metavar="N", **_with(default, meaning))

    def numbers(self, name: str, default: Iterable[int], meaning: str = "", low: int = 1) -> None:
        """Add an option for one or more whole numbers, as ``number`` does for one."""
        words = _with([*default], meaning)
        self.add_argument(name, type=int_at_least(low), nargs="+", metavar="N", **words)

    def some(self, name: str, choices: Iterable[str], default: Sequence[str] = ()) -> None:
        """Add an option that takes one or more of the ``choices``; its default is all of them."""
        known = [*choices]
        self.add_argument(name, nargs="+", choices=known, **_with([*(default or known)]))

    def drivers(self, *default: str, name: str = "--driver") -> None:
        """Add an option that takes one or more drivers."""
        self.add_argument(name, nargs="+", metavar="NAME", **_with([*default], driver_words()))

    def checks(self, known: Iterable[str], **options: Any) -> None:
        """Add the option ``--safety-check``: a name among ``known``, or ``module:function``.

        ``options`` are those of ``add_argument``.
        """
        names = list(known)

        def check(word: str) -> str:
            if word not in names and not is_factory(word):
                raise argparse.ArgumentTypeError(
                    f"{word!r} is no check{did_you_mean(word, names)}: give one of "
                    f"{', '.join(names)}, or your own as module:function"
                )
            return word

        text = f"{', '.join(names)}, or your own as module:function"
        self.add_argument("--safety-check", type=check, metavar="NAME", help=text, **options)

    def spent_s(self) -> float:
        """Return the wall time since the program began, seconds."""
        return time.monotonic() - self._begun_s

    def made_by(self, before_s: float = 0.0) -> str:
        """Return the line of ``made_by`` about this program.

        Its wall time includes ``before_s``, the wall time of earlier runs, seconds.
        """
        return made_by(before_s + self.spent_s())


def made_by(seconds: float) -> str:
    """Return command, wall time, date, versions and machine in one line, for results in text files.

    ``seconds`` is the wall time.
    """
    facts = provenance(Config())
    versions = ", ".join(f"{package} {facts[package]}" for package in ("python", *PACKAGES))
    return (
        f"made by {facts['command']} in {seconds:.0f} s on {facts['date']}: "
        f"{versions}; {facts['machine']}; {facts['blas']}"
    )


def _with(default: Any, meaning: str = "") -> dict[str, Any]:
    """Return the default of an option, and the help that shows it after ``meaning``."""
    shown = " ".join(map(str, default)) if isinstance(default, list) else default
    text = f"{meaning} (default: {shown})" if meaning else f"default: {shown}"
    return {"default": default, "help": text}


def run_program(main: Callable[[], int | None]) -> None:
    """Run a program and exit with its status; after an error or Ctrl-C it prints one sentence."""
    sys.exit(exit_status(Path(sys.argv[0]).stem, lambda: main() or 0))
