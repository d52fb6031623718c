"""Groups the rows of studies, and computes the cells of tables and the points of figures.

A *specification* is a part [tables.NAME] or [figures.NAME] of a study's file; docs/extend/study.md
describes its keys. A *measure* computes one cell from the episodes of a group.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from drl_av.errors import DrlAvError
from drl_av.evaluation.aggregates import Estimate, interquartile_mean, probability_of_improvement
from drl_av.evaluation.statistics import Mean, best_opponent, gain, mean_with_interval
from drl_av.evaluation.table import report_corrupt_table
from studies.options import FOLDER, Options
from studies.results import markdown_table
from studies.study import MEASURES, FileStudy

Spec = Mapping[str, Any]
Frame: TypeAlias = Any
"""A pandas DataFrame, which has no types."""
Value = Mean | Estimate | str | None
SPEED = "mean_speed_m_s"


def markdown(study: FileStudy, spec: Spec, folder: Path) -> str:
    """Return the Markdown table of a specification for the results in ``folder``.

    Raises DrlAvError if a table is damaged, or drivers that are compared did not drive the same
    traffic.
    """
    pivot = Pivot(study, spec, folder)
    columns = pivot.columns()
    measures = spec.get("measures", [])
    heads = [*spec.get("heads", pivot.names)]
    if not pivot.names:  # a line for each measure
        lines = [
            [each["head"], *(pivot.text(each, {}, column) for column in columns.values())]
            for each in measures
        ]
        return markdown_table([*heads, *columns], lines)
    lines = pivot.lines(columns, measures)
    return markdown_table([*heads, *columns, *(each["head"] for each in measures)], lines)


class Pivot:
    """The rows of one or several studies in groups, as a specification demands."""

    def __init__(self, study: FileStudy, spec: Spec, folder: Path) -> None:
        self.study, self.spec, self.folder = study, spec, folder
        sources = spec.get("from", [{"study": study.name}])
        rows = pd.concat(list(self._sources(sources)), ignore_index=True)
        for column, name in spec.get("total", {}).items():
            rows = pd.concat([rows, rows.assign(**{column: name})], ignore_index=True)
        self.rows = select(rows, spec.get("where", {}))
        """All rows, with those to which others are compared."""
        self.shown = self.rows
        for column, values in spec.get("without", {}).items():
            self.shown = self.shown[~self.shown[column].isin(values)]
        if "best" in spec:
            self.shown = select(self.shown, {"driver": spec["ours"]})
        self.names = [name.strip("`") for name in spec.get("rows", [])]
        self._selected: dict[tuple[Any, ...], Frame] = {}

    def _sources(self, sources: Iterable[Spec]) -> Iterator[Frame]:
        """Yield the rows of each source; another study that has no results here is left out."""
        for source in sources:
            name = source["study"]
            own = name == self.study.name
            if own or (self.folder / f"{name}.csv").exists():
                study = self.study if own else FileStudy(FOLDER / f"{name}.toml")
                yield _source(study, source, self.folder)

    def _select(self, rows: Frame, where: Spec) -> Frame:
        """Return ``select(rows, where)``; all selections on the way to it are kept."""
        at: tuple[Any, ...] = (id(rows),)
        for column, wanted in where.items():
            at = (*at, column, str(wanted))
            if at not in self._selected:
                self._selected[at] = select(rows, {column: wanted})
            rows = self._selected[at]
        return rows

    def columns(self) -> dict[str, Spec]:
        """Return which rows belong to each column of the table, by its heading."""
        if (name := self.spec.get("columns")) is None:
            return {}
        found = {str(value): {name: value} for value in values_of(self.rows, name)}
        pools = self.spec.get("pool", {}).items()
        return found | {head: {name: {"min": low, "max": high}} for head, (low, high) in pools}

    def keys(self, names: Sequence[str], rows: Frame) -> list[dict[str, Any]]:
        """Return the values of ``names`` in each group; values are in the order of their rows."""
        if not names:
            return [{}]
        return [
            {names[0]: value, **rest}
            for value in dict.fromkeys(rows[names[0]])
            for rest in self.keys(names[1:], rows[rows[names[0]] == value])
        ]

    def lines(self, columns: Mapping[str, Spec], measures: Sequence[Spec]) -> list[list[str]]:
        """Return the lines of the table: texts of the group, the columns and the measures."""
        spec, lines, group = self.spec, [], None
        for key in self.keys(self.names, self.shown):
            outer = {name: key[name] for name in self.names[:-1]}
            if "best" in spec and outer != group:
                names = [self.best({**outer, **column}) for column in columns.values()]
                lines.append([*outer.values(), spec["best"], *names])
                group = outer
            lines.append(self._line(key, columns, measures))
            if "slowest" in spec and (unit := self._slowest(key)):
                line = self._line(key | {spec["units"]: unit}, columns, measures)
                lines.append([spec["slowest"].format(unit), *line[1:]])
        return lines

    def _line(
        self, key: Mapping[str, Any], columns: Mapping[str, Spec], measures: Sequence[Spec]
    ) -> list[str]:
        names = zip(self.spec.get("rows", []), self.names, strict=True)
        heads = [f"`{key[name]}`" if shown != name else str(key[name]) for shown, name in names]
        heads = [*heads[:-1], self.spec.get("text", "{}").format(heads[-1])]
        cells = [self.text(self.spec["value"], key, column) for column in columns.values()]
        return heads + cells + [self.text(each, key, {}) for each in measures]

    def _slowest(self, key: Mapping[str, Any]) -> str | None:
        """Return the unit with the lowest mean speed in a group; None if there is only one."""
        means = self._select(self.shown, key).groupby(self.spec["units"])[SPEED].mean()
        return str(means.idxmin()) if len(means) > 1 else None

    def text(self, spec: Spec, key: Mapping[str, Any], column: Spec) -> str:
        """Return the text of the cell that a measure computes for a group and a column."""
        return show(self.value(spec, key, column), spec.get("digits", 2))

    def value(self, spec: Spec, key: Mapping[str, Any], column: Spec) -> Value:
        """Return the value that a measure computes for a group and a column; None if empty."""
        own = self._select(self.shown, {**key, **column})
        if own.empty:
            return None
        other = self._other(spec, {**key, **column})
        if other is not None:
            is_itself = own.index.equals(other.index) and ("of" in spec or "improvement" in spec)
            if other.empty or is_itself:
                return None
        units = self.spec.get("units")
        if units is None or own[units].nunique() < 2 or "text" in spec:
            return measure(spec, own, other, units)
        if "iqm" in spec or "improvement" in spec:
            raise DrlAvError(f"The measure {spec} is one of episodes: leave units out.")
        found = [measure(spec, each, other) for _, each in own.groupby(units, sort=False)]
        return mean_with_interval(each.value for each in found if isinstance(each, Mean))

    def _other(self, spec: Spec, key: Mapping[str, Any]) -> Frame | None:
        """Return the rows to which a measure compares those of a group; None if to none."""
        over = spec.get("over", spec.get("of"))
        if over is None:
            return None
        if over == "best":
            rest = {name: value for name, value in key.items() if name != "label"}
            return self._select(self.rows, rest | {"label": self.best(rest)})
        dropped = over.keys() | (set() if over.keys() == {"variant"} else {"label", "training"})
        return self._select(self.rows, {n: v for n, v in key.items() if n not in dropped} | over)

    def best(self, key: Spec) -> str:
        """Return the label of the fastest driver that is not ours in the traffic that all drove."""
        rows = self._select(self.rows, key)
        rivals = rows[~rows["driver"].isin(self.spec.get("ours", ()))]
        met = rivals.groupby(traffic_of(rivals))["label"].transform("nunique")
        rivals = rivals[met == met.max()]
        speeds = dict(iter(rivals.groupby("label", sort=False)[SPEED]))
        return best_opponent(speeds) or ""


def measure(spec: Spec, own: Frame, other: Frame | None = None, units: str | None = None) -> Value:
    """Return what a measure computes from the episodes ``own``, compared to ``other``."""
    [kind] = spec.keys() & MEASURES
    expression = spec[kind]
    if kind in ("mean", "interval"):
        mean = mean_with_interval(own.eval(expression).astype(float), own["seed"])
        return mean if kind == "interval" else Mean(mean.value, math.inf)
    if kind == "total":
        sums = pd.DataFrame([own.sum(numeric_only=True).astype(float)])
        total = float(sums.eval(expression).iloc[0])
        return Mean(0.0 if math.isnan(total) else total, math.inf)
    if kind == "text":
        sums = own[[name for name in ("ego_hit", "was_hit") if name in own]].sum()
        number = own[units].nunique() if units else 1
        sizes = {"episodes": len(own), "units": number, "each": len(own) // number}
        return str(expression.format(**sizes, **sums))
    if kind == "iqm":
        return interquartile_mean(_strata(own, expression))
    assert other is not None
    if kind == "improvement":
        return probability_of_improvement(_strata(own, expression), _strata(other, expression))
    ours, theirs = by_traffic(own, expression), by_traffic(other, expression)
    if spec.get("common"):
        both = [traffic for traffic in ours if traffic in theirs]
        ours, theirs = ({traffic: side[traffic] for traffic in both} for side in (ours, theirs))
    if "of" in spec:
        ours, theirs = theirs, ours
    if kind == "change":
        percent = 100 / (sum(theirs.values()) / max(len(theirs), 1))
        ours, theirs = ({at: v * percent for at, v in side.items()} for side in (ours, theirs))
    return gain(ours, theirs)


def show(value: Value, digits: int = 2) -> str:
    """Return the text of a value."""
    if isinstance(value, Mean):
        return f"{value:.{digits}f}"
    return "" if value is None else str(value)


def select(rows: Frame, where: Mapping[str, Any]) -> Frame:
    """Return the rows in which each column has a value: one, one of a list, or from min to max."""
    for column, wanted in where.items():
        if isinstance(wanted, Mapping):
            low, high = wanted.get("min", -math.inf), wanted.get("max", math.inf)
            rows = rows[rows[column].between(low, high)]
        elif isinstance(wanted, list):
            rows = rows[rows[column].isin(wanted)]
        else:
            rows = rows[rows[column] == wanted]
    return rows


def values_of(rows: Frame, column: str) -> list[Any]:
    """Return the values of a column: numbers in ascending order, texts as they come."""
    found = list(dict.fromkeys(rows[column]))
    return found if rows[column].dtype == object else sorted(found)


def _strata(rows: Frame, column: str) -> list[Any]:
    names = [name for name in ("traffic", "vehicles") if name in rows]
    ordered = rows.sort_values("seed", kind="stable")
    return [own.to_numpy() for _, own in ordered.groupby(names)[column]]


def traffic_of(rows: Frame) -> list[str]:
    """Return the columns that together name the traffic of an episode, its seed last."""
    return [name for name in ("traffic", "vehicles", "seed") if name in rows]


def by_traffic(rows: Frame, column: str) -> dict[Any, float]:
    """Return the value of a column in each traffic: by its kind, number of vehicles and seed.

    Raises DrlAvError if several rows have the same traffic, which would not be pairs.
    """
    keys = [rows[name] for name in traffic_of(rows)]
    found = dict(zip(zip(*keys, strict=True), rows[column], strict=True))
    if len(found) < len(rows):
        raise DrlAvError(
            f"A gain compares pairs of episodes, but {len(rows)} rows have {len(found)} kinds of "
            "traffic: group them further with rows, columns, where or units."
        )
    return found


def _source(study: FileStudy, source: Spec, folder: Path) -> Frame:
    """Return the rows of a source: a study, columns that select rows, and columns to add."""
    rows = labelled(study, folder)
    chosen = {name: each for name, each in source.items() if name in rows and name != "label"}
    rows = select(rows, chosen)
    added = {n: v for n, v in source.items() if n not in rows and n not in ("study", "label")}
    if label := source.get("label"):
        names = rows["driver"] if "driver" in rows else [""] * len(rows)
        added["label"] = [label.format(driver=name) for name in names]
    return rows.assign(**added)


def labelled(study: FileStudy, folder: Path) -> Frame:
    """Return the rows of a study in ``folder``, with a column "label" for tables and figures.

    Truth values are numbers, and a column "was_hit" tells whether another vehicle hit the ego.

    Raises DrlAvError if the table is missing or damaged.
    """
    path = folder / f"{study.name}.csv"
    if not path.exists():
        raise DrlAvError(f"{path} does not exist: python -m studies {study.word} makes it.")
    with report_corrupt_table(path):
        return _read(study.path, path, path.stat().st_mtime_ns)


@cache
def _read(described: Path, path: Path, changed_ns: int) -> Frame:
    rows = pd.read_csv(path, float_precision="round_trip", keep_default_na=False)
    for column in rows.select_dtypes(bool):
        rows[column] = rows[column].astype(int)
    if {"collided", "ego_hit"} <= {*rows.columns}:
        rows["was_hit"] = rows["collided"] - rows["ego_hit"]
    return rows.assign(label=_labels(FileStudy(described), rows))


def _labels(study: FileStudy, rows: Frame) -> Any:
    column = next((name for name in ("training", "driver") if name in rows), None)
    names = None if column is None else rows[column]
    labels = pd.Series("", index=rows.index, dtype=object)
    for variant in study.variants:
        fixed = variant.columns | ({"variant": variant.name} if "variant" in rows else {})
        own = select(rows, {column: _typed(rows, column, v) for column, v in fixed.items()}).index
        if names is None:
            labels[own] = variant.label
        else:
            labels[own] = [study.filled(variant.label, driver=each) for each in names[own]]
    if names is None:
        return labels
    trained = {each.name: each.label for each in study.trained(Options())}
    present = [trained[name] for name in dict.fromkeys(names) if name in trained]
    counts = {label: present.count(label) for label in present}
    made = names.isin([*trained])
    labels[made] = [trained[n].format(count=counts[trained[n]]) for n in names[made]]
    return labels


def _typed(rows: Frame, column: str, text: str) -> Any:
    return text if rows[column].dtype == object else np.float64(text)
