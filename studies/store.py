"""Stores results as a CSV table, and its provenance (how it was made) as a JSON file beside it."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from drl_av.config import Config, from_toml
from drl_av.errors import ConfigError, DrlAvError
from drl_av.evaluation.provenance import provenance, read_sidecar, sidecar, write_sidecar
from drl_av.files import (
    LARGEST,
    SHOWN,
    Row,
    make_folder,
    read_table,
    require_writable,
    write_table,
)
from studies.options import ReproduceOptions
from studies.values import require_values

Derived = Mapping[str, Callable[[list[Row]], list[Row]]]
"""Functions that compute further tables from a table's rows, by the further table's file name."""


class MadeWith(NamedTuple):
    """The settings and drivers with which rows were made, by the name of a training or variant.

    If all rows share one config and the same drivers, the only name may be "".
    """

    settings: Mapping[str, Config]
    policies: Mapping[str, str | None] = {}
    """SHA-256 of the learned drivers' weights; None if all drivers are rule-based."""
    episodes: Mapping[str, int] = {}
    """Number of training episodes of the drivers."""

    def contradicts(self, other: "MadeWith") -> bool:
        """Return whether a name has another config, policy or number of episodes in ``other``.

        The result is also True if only one of the two values uses the name "" for its settings.
        """
        pairs: list[tuple[Mapping[str, Any], Mapping[str, Any]]]
        pairs = [*zip(self, other, strict=True)]
        shared = bool(self.settings and other.settings)
        return (shared and ("" in self.settings) != ("" in other.settings)) or any(
            mine.get(name, value) != value for mine, its in pairs for name, value in its.items()
        )

    def extended(self, other: "MadeWith") -> "MadeWith":
        """Return a value with the entries of both; for a name in both, that of ``other``."""
        return MadeWith(
            {**self.settings, **other.settings},
            {**self.policies, **other.policies},
            {**self.episodes, **other.episodes},
        )


class ResultStore:
    """A results table on disk, to which missing rows are added; ``order(row)`` is the sort key.

    ``named`` is the column with the name of a row's settings, or "" if there is none.

    Raises:
        DrlAvError: the table was made with other settings or another driver, is damaged, or cannot
            be written.
    """

    def __init__(
        self,
        path: Path,
        made_with: MadeWith,
        order: Callable[[Row], Any],
        derived: Derived | None = None,
        named: str = "",
    ) -> None:
        self.path, self._order = path, order
        self._derived = {path.with_name(name): derive for name, derive in (derived or {}).items()}
        make_folder(path.parent, "--out")
        require_writable(path, sidecar(path), *self._derived)
        with report_corrupt_table(path):
            facts = read_sidecar(path)
            rows = read_rows(path)
            require_values(rows)
            self.rows = sorted(rows, key=order)
            places = [order(row) for row in self.rows]
            if twice := [a for a, b in pairwise(places) if a == b]:
                raise ValueError(f"the row {twice[0]} is there twice")
            if self.rows:
                self._derive()
            self._made_with = _stored(facts, path) if self.rows or facts else made_with
            _require_settings(self.rows, named, self._made_with)
            self.seconds = _seconds(facts)
        self.require(made_with)

    def of(self, key: Row) -> list[Row]:
        """Return the rows whose columns have the values in ``key``."""
        return [row for row in self.rows if key.items() <= row.items()]

    def require(self, made_with: MadeWith) -> None:
        """Add the settings and drivers of new rows to those of the table.

        Raises DrlAvError if the table's rows were made with other settings or drivers.
        """
        if made_with.contradicts(self._made_with):
            raise settings_mismatch(self.path)
        self._made_with = self._made_with.extended(made_with)

    def require_columns(self, row: Row) -> None:
        """Raise DrlAvError if the table's rows have other columns than ``row``."""
        if self.rows and row.keys() != self.rows[0].keys():
            raise settings_mismatch(self.path)

    def put(self, key: Row, rows: Sequence[Row]) -> bool:
        """Replace the rows of ``key`` if ``rows`` holds more; return whether they were replaced."""
        if len(rows) <= len(self.of(key)):
            return False
        self.require_columns(rows[0])
        others = [row for row in self.rows if not key.items() <= row.items()]
        self.rows = sorted([*others, *rows], key=self._order)
        return True

    def save(self, options: ReproduceOptions) -> None:
        """Write the provenance, the table and the derived tables in this order, each atomically."""
        write_sidecar(self.path, self._facts(options))
        write_table(self.path, self.rows[0], self.rows)
        self.save_derived()

    def save_derived(self) -> None:
        """Write the tables that derive from this one, unless they have no rows yet.

        Raises DrlAvError if that fails.
        """
        if self.rows:
            with report_corrupt_table(self.path):
                derived = self._derive()
            for path, rows in derived.items():
                if rows:
                    write_table(path, rows[0], rows)

    def _derive(self) -> dict[Path, list[Row]]:
        try:
            return {path: derive(self.rows) for path, derive in self._derived.items()}
        except DrlAvError as error:
            raise ValueError(str(error)) from error

    def _facts(self, options: ReproduceOptions) -> dict[str, Any]:
        settings, policies, episodes = self._made_with
        times = {name: round(seconds, 1) for name, seconds in self.seconds.items()}
        seeds = sorted({int(row["seed"]) for row in self.rows})
        facts: dict[str, Any] = {
            "engine": options.engine,
            "processes": options.jobs,
            "seeds": f"{seeds[0]} to {seeds[-1]}",
            "wall_time_s": times[""] if times.keys() == {""} else times,
        }
        if "" not in policies and policies:
            facts["policies_sha256"] = dict(policies)
        elif policies.get(""):
            facts["policy_sha256"] = policies[""]
        if episodes:
            facts["episodes"] = dict(episodes)
        stored = {name: asdict(config) for name, config in settings.items()}
        facts["settings"] = stored.get("", stored)
        return provenance(next(iter(settings.values())), **facts)


def _stored(facts: dict[str, Any], table: Path) -> MadeWith:
    """Return the settings and drivers in ``facts``, which are the provenance of a table.

    Damaged facts cause errors that ``report_corrupt_table`` converts to DrlAvError.
    """
    settings, name = facts["settings"], str(sidecar(table))
    try:
        if "simulation" in settings:
            config = stored_config(settings, name)
            return MadeWith({"": config}, {"": facts.get("policy_sha256")})
        configs = {training: stored_config(each, name) for training, each in settings.items()}
    except ConfigError as error:
        raise ValueError(str(error)) from error
    return MadeWith(configs, facts.get("policies_sha256", {}), facts.get("episodes", {}))


def _require_settings(rows: Sequence[Row], named: str, made_with: MadeWith) -> None:
    """Raise LookupError if a row has no settings; the column ``named`` has their name."""
    names = {row[named] for row in rows} if named else set()
    if missing := sorted(names - made_with.settings.keys()):
        raise LookupError(f"no settings of {missing[0]}")
    if rows and not made_with.settings:
        raise LookupError("no settings")


def _seconds(facts: dict[str, Any]) -> dict[str, float]:
    """Return the wall times in ``facts``, s, by name of training; the name "" means all rows."""
    times = facts["wall_time_s"] if facts else {}
    named: dict[str, Any] = times if isinstance(times, dict) else {"": times}
    if not all(0 <= float(seconds) <= LARGEST for seconds in named.values()):
        raise ValueError(f"wall_time_s is {str(times)[:SHOWN]}")
    return {name: float(seconds) for name, seconds in named.items()}


def stored_config(settings: dict[str, Any], name: str) -> Config:
    """Return the config with which a table was made; missing settings get their former defaults.

    ``name`` is the name of the file, for the error message.

    Raises:
        ConfigError: this version does not know a setting in ``settings``.
    """
    return from_toml(tomli_w.dumps(settings), name=name)


@contextmanager
def report_corrupt_table(table: Path) -> Iterator[None]:
    """Convert the errors that damaged rows or facts cause in the block to DrlAvError."""
    try:
        yield
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
        raise DrlAvError(
            f"{table}, or the file beside it, is damaged or of another version ({error!r}): "
            "put both back as they were, or move them away to make them again."
        ) from error


def settings_mismatch(table: Path) -> DrlAvError:
    """Return the error for a table that was made with other settings or drivers."""
    return DrlAvError(
        f"{table} was made with other settings or another driver: choose another folder with "
        f"--out, or move it and {sidecar(table).name} away to make it again."
    )


def read_rows(table: Path) -> list[Row]:
    """Read the rows of a CSV table as text; [] if the file does not exist.

    Raises the errors of ``files.read_table``.
    """
    return read_table(table) if table.exists() else []


def seeds_held(rows: Iterable[Row], drivers: int = 1, first: int = 0) -> int:
    """Return the number of traffic seeds in the rows, after a check that none is missing.

    The seeds must be ``first``, ``first`` + 1, and so on, and each must occur ``drivers`` times:
    once for each driver.

    Raises:
        ValueError: a seed is missing or occurs twice.
    """
    seeds = sorted(int(row["seed"]) for row in rows)
    count = len(seeds) // drivers
    if seeds != sorted([*range(first, first + count)] * drivers):
        raise ValueError("a seed is missing, or there twice")
    return count
