"""A table of results on disk to which missing rows are added, with its provenance beside it."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from drl_av.config import Config, from_toml
from drl_av.config.functions import is_factory, source_digest
from drl_av.drivers.external import files_of
from drl_av.drivers.policy_file import find_policy
from drl_av.drivers.registry import DriverSpec
from drl_av.env.metrics import USUAL, EpisodeResult
from drl_av.errors import ConfigError, DrlAvError
from drl_av.evaluation.criticality import CriticalityResult
from drl_av.evaluation.provenance import (
    PACKAGES,
    checksum,
    provenance,
    read_provenance,
    write_provenance,
)
from drl_av.files.atomic import files_digest, hold, make_folder, require_writable
from drl_av.files.table import (
    LARGEST,
    SHOWN,
    PlainNumber,
    Row,
    column_types,
    parse_cell,
    read_table,
    write_table,
)

TYPES: Mapping[str, Any] = {
    name: PlainNumber if kind in (int, float) else kind
    for name, kind in column_types(CriticalityResult).items()
}
"""The type of each column of an episode; counts may be fractions, as in a table of means."""


class Inputs(NamedTuple):
    """The settings and drivers with which rows were made, by the name of a training or variant.

    If all rows share one config, the only name of ``settings`` is "".
    """

    settings: Mapping[str, Config]
    policies: Mapping[str, str] = {}
    """SHA-256 of each learned driver's weights, by its name; rule-based drivers have none."""
    episodes: Mapping[str, int] = {}
    """Number of training episodes of the drivers."""
    custom: Mapping[str, str] = {}
    """What the rows rest on besides: the scenario's files, and what the user has added."""

    def conflict(self, other: "Inputs") -> str:
        """Return what two values disagree on, such as "safety.check"; "" if nothing.

        They also disagree if only one of them uses the name "" for its settings.
        """
        if self.settings and other.settings and ("" in self.settings) != ("" in other.settings):
            return "settings"
        for name in self.settings.keys() & other.settings.keys():
            mine, its = asdict(self.settings[name]), asdict(other.settings[name])
            for section, settings in mine.items():
                for key in (key for key in settings if settings[key] != its[section][key]):
                    return f"{section}.{key}"
        pairs: list[tuple[Mapping[str, Any], Mapping[str, Any]]]
        pairs = [*zip(self[1:], other[1:], strict=True)]
        differ = (n for own, its in pairs for n, v in its.items() if own.get(n, v) != v)
        return next(differ, "")

    def extended(self, other: "Inputs") -> "Inputs":
        """Return a value with the entries of both; for a name in both, that of ``other``."""
        pairs: Iterable[tuple[Mapping[str, Any], Mapping[str, Any]]] = zip(self, other, strict=True)
        return Inputs(*({**mine, **its} for mine, its in pairs))


def checksums(specs: Iterable[DriverSpec]) -> dict[str, str]:
    """Return the SHA-256 of each driver that comes from a file, by its name.

    It is that of the weights of a driver that this package trained, of each file of any other one,
    and of the module of a user's factory.

    Raises RunError or CheckpointError if a learned driver cannot be read.
    """
    found = dict[str, str]()
    for each in specs:
        if each.run and each.is_external:
            found[each.name] = " ".join(map(files_digest, files_of(each.run)))
        elif each.run:
            found[each.name] = checksum(find_policy(each.run))
        elif each.own is None and is_factory(word := each.name.partition("@")[0]):
            found[each.name] = source_digest(word)
    return found


class ResultTable:
    """A table on disk to which missing rows are added; rows that it has are never replaced.

    Args:
        path: The CSV file.
        inputs: The settings and drivers of the new rows.
        place: Returns the sort key of a row, a tuple that no other row has. It raises ValueError
            or LookupError for a row that does not belong into this table.
        suffix: The ending of the JSON file with the provenance, NAME.json beside NAME.csv.

    Raises:
        DrlAvError: the table was made with other settings or another driver, is damaged, cannot
            be written, or another process writes to it.
    """

    def __init__(
        self,
        path: Path,
        inputs: Inputs,
        place: Callable[[Row], tuple[Any, ...]],
        suffix: str = ".json",
    ) -> None:
        self.path, self.beside, self._place = path, path.with_suffix(suffix), place
        self._suffix = suffix
        make_folder(path.parent, "--out")
        require_writable(path, self.beside)
        hold(path)
        self._written = _stamp(path)
        self._rows: dict[tuple[Any, ...], Row] = {}
        with report_corrupt_table(path):
            rows = read_rows(path)
            facts = read_provenance(path, suffix) if rows else {}
            require_values(rows)
            for row in rows:
                if (at := place(row)) in self._rows:
                    raise ValueError(f"the row {at} is there twice")
                self._rows[at] = row
            self._inputs = _stored(facts, self.beside) if rows else inputs
            self._former = facts
            self.seconds = _seconds(facts)
        self.require(inputs)

    @property
    def rows(self) -> list[Row]:
        """The rows in the order of their places."""
        return [self._rows[place] for place in sorted(self._rows)]

    def __contains__(self, row: Row) -> bool:
        """Return whether the table has a row at the place of ``row``."""
        return self._place(row) in self._rows

    def of(self, key: Row) -> list[Row]:
        """Return the rows whose columns have the values in ``key``, in order."""
        return [row for row in self.rows if key.items() <= row.items()]

    def require(self, inputs: Inputs) -> None:
        """Add the settings and drivers of new rows to those of the table.

        Raises DrlAvError if the table's rows were made with other settings or drivers.
        """
        if conflict := inputs.conflict(self._inputs):
            raise settings_mismatch(self.path, self.beside, conflict)
        self._inputs = self._inputs.extended(inputs)

    def add(self, *rows: Row) -> bool:
        """Add those of the rows that the table lacks; return whether there are any.

        Raises DrlAvError if the table's rows have other columns.
        """
        new = [row for row in rows if row not in self]
        for row in new:
            had = next(iter(self._rows.values()), row)
            if other := [name for name in (*row, *had) if (name in row) != (name in had)]:
                which = "only here" if other[0] in row else "only there"
                raise settings_mismatch(self.path, self.beside, f"column {other[0]}, {which}")
            self._rows[self._place(row)] = row
        return bool(new)

    def save(self, **facts: Any) -> None:
        """Write the provenance, with ``facts``, and then the table, each atomically.

        Raises DrlAvError if the write fails, or if another process has written the table.
        """
        if rows := self.rows:
            if _stamp(self.path) != self._written:
                raise DrlAvError(
                    f"{self.path} has been changed by another process since this one read it: give "
                    "the same command again, which adds to what is there now."
                )
            write_provenance(self.path, self._facts(rows, facts), self._suffix)
            write_table(self.path, rows[0], rows)
            self._written = _stamp(self.path)

    def _facts(self, rows: Sequence[Row], given: Mapping[str, Any]) -> dict[str, Any]:
        settings, policies, episodes, custom = self._inputs
        times = {name: round(seconds, 1) for name, seconds in self.seconds.items()}
        facts: dict[str, Any] = {
            **given,
            "seeds": _ranges({int(row["seed"]) for row in rows}),
            "wall_time_s": times[""] if times.keys() == {""} else times,
        }
        if policies:
            facts["policies_sha256"] = dict(policies)
        if episodes:
            facts["episodes"] = dict(episodes)
        if custom:
            facts["custom"] = dict(custom)
        stored = {name: asdict(config) for name, config in settings.items()}
        facts["settings"] = stored.get("", stored)
        made = provenance(next(iter(settings.values())), **facts)
        before, makers = [*self._former.get("before", [])], ("python", *PACKAGES, "machine", "blas")
        if self._former and any(self._former.get(name) != made[name] for name in makers):
            before.append({name: self._former.get(name) for name in ("command", "date", *makers)})
        return {**made, "before": before} if before else made


def _ranges(numbers: Collection[int]) -> str:
    """Return whole numbers in words, such as "0 to 9, 20 to 29"."""
    begins, ends = ([n for n in sorted(numbers) if n + side not in numbers] for side in (-1, 1))
    return ", ".join(f"{begin} to {end}" for begin, end in zip(begins, ends, strict=True))


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return what tells a file from one that another process has put in its place; None if none."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    return found.st_ino, found.st_mtime_ns


def _stored(facts: dict[str, Any], beside: Path) -> Inputs:
    """Return the settings and drivers in ``facts``, which are the provenance of a table.

    Damaged facts cause errors that ``report_corrupt_table`` converts to DrlAvError.
    """
    if not (settings := facts["settings"]):
        raise LookupError("no settings")
    named = {"": settings} if "simulation" in settings else settings
    try:
        configs = {name: stored_config(each, str(beside)) for name, each in named.items()}
    except ConfigError as error:
        raise ValueError(str(error)) from error
    others = (facts.get(name, {}) for name in ("policies_sha256", "episodes", "custom"))
    return Inputs(configs, *others)


def _seconds(facts: dict[str, Any]) -> dict[str, float]:
    """Return the wall times in ``facts``, s, by name of training; the name "" means all rows."""
    times = facts["wall_time_s"] if facts else {}
    named: dict[str, Any] = times if isinstance(times, dict) else {"": times}
    if not all(0 <= float(seconds) <= LARGEST for seconds in named.values()):
        raise ValueError(f"wall_time_s is {str(times)[:SHOWN]}")
    return {name: float(seconds) for name, seconds in named.items()}


def stored_config(settings: dict[str, Any], name: str) -> Config:
    """Return the config with which a table was made; missing settings get their defaults.

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
        reason = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise DrlAvError(
            f"{table}, or the file beside it, is damaged or of another version ({reason}): "
            "put both back as they were, or move them away to make them again."
        ) from error


def settings_mismatch(table: Path, beside: Path, conflict: str) -> DrlAvError:
    """Return the error for a table that was made with other settings or drivers."""
    return DrlAvError(
        f"{table} was made with other settings, columns or drivers ({conflict}): choose another "
        f"--out, or move it and {beside.name} away to make it again."
    )


def read_rows(table: Path) -> list[Row]:
    """Read the rows of a CSV table as text; [] if the file does not exist.

    Raises the errors of ``files.read_table``.
    """
    return read_table(table) if table.exists() else []


def results_of(rows: Iterable[Row], kind: type[EpisodeResult]) -> list[EpisodeResult]:
    """Return rows of text as results of the class ``kind``.

    Errors of a damaged row are those that ``report_corrupt_table`` converts to DrlAvError.
    """
    types = column_types(kind)
    return [
        kind(**{name: parse_cell(cell, types[name]) for name, cell in row.items()}) for row in rows
    ]


def read_results(table: Path) -> list[EpisodeResult]:
    """Read a table of ``drl-av evaluate``, also with ``--criticality``; ignore other columns.

    Raises:
        DrlAvError: the table is missing, damaged, or of another kind.
    """
    header = read_table(table)[0]
    kind = CriticalityResult if "driven_m" in header else EpisodeResult
    names = [name for name in column_types(kind) if name in header or name not in USUAL]
    rows = read_table(table, dict.fromkeys(names, str))
    with report_corrupt_table(table):
        require_values(rows)
        return results_of(rows, kind)


def require_values(rows: Iterable[Row]) -> None:
    """Raise ValueError if a cell does not have the type of its column.

    ``TYPES`` holds the types. In all other columns a cell is a text, or a finite number of at most
    ``files.LARGEST``.
    """
    for line, row in enumerate(rows, start=2):
        for column, cell in row.items():
            kind = TYPES.get(column) or (PlainNumber if _is_number(cell) else str)
            try:
                parse_cell(cell, kind)
            except ValueError as error:
                raise ValueError(f"line {line}: {column} is {cell[:SHOWN]}") from error


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
