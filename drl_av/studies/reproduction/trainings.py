"""Trainings spread over processes, and one table of what they brought, each episode once."""

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.config import Config
from drl_av.errors import DrlAvError
from drl_av.studies.files import require_writable
from drl_av.studies.reproduction.engines import ENGINES
from drl_av.studies.reproduction.legs import Leg, drive_leg, episodes_driven, wall_time_s
from drl_av.studies.reproduction.provenance import (
    provenance,
    read_sidecar,
    sidecar,
    stored_config,
    write_sidecar,
)
from drl_av.studies.reproduction.scale import Progress, Scale
from drl_av.studies.reproduction.tables import Row, intact, read_rows, write_rows

Training = tuple[str, str]
"""A variant and a seed."""


class Table(NamedTuple):
    """Where the rows of some trainings go, and how they are made."""

    path: Path
    configs: Mapping[str, Config]
    """The settings of every variant, with seed 0."""
    rows_of: Callable[[Leg], list[Row]]
    identity: Mapping[str, str] = {}
    """What else must be the same for rows to stand in one table."""
    written: Callable[[list[Row]], None] = lambda rows: None
    """Called with the rows when the file is new."""


def trained(
    scale: Scale, table: Table, rounds: Sequence[Sequence[Leg]]
) -> Generator[Progress, None, None]:
    """Drive the legs of each round, and keep the table up to date.

    What the table holds already is not trained again, whether or not the folders of those
    trainings are still there.

    Raises:
        DrlAvError: the table was made with other settings, or the disk refuses.
        RunError, SimulationError: a training cannot go on.
    """
    table.path.parent.mkdir(parents=True, exist_ok=True)
    scale.runs.mkdir(parents=True, exist_ok=True)
    require_writable(table.path, sidecar(table.path))
    _require_same_settings(table)
    goals = list({leg.folder: leg for legs in rounds for leg in legs}.values())
    _collect(scale, table, goals)
    yield _progress(table, goals)
    for legs in rounds:
        try:
            left = missing(table, legs)
            with closing(ENGINES[scale.engine](drive_leg, left, scale.jobs)) as engine:
                for ended in engine:
                    if ended:
                        _collect(scale, table, goals)
                    yield _progress(table, goals)
        finally:
            _collect(scale, table, goals)


def missing(table: Table, legs: Iterable[Leg]) -> list[Leg]:
    """The legs that have not brought all their rows; raises DrlAvError as ``trained``."""
    _require_same_settings(table)
    last = _last_episodes(table)
    return [leg for leg in legs if last.get((leg.variant, str(leg.seed)), 0) < leg.last_row]


def merged(stored: Iterable[Row], found: Iterable[Row], variants: Iterable[str]) -> list[Row]:
    """Each training's rows from the side that got further with it; in the order of the variants.

    Raises:
        DrlAvError: a side holds an episode of a training twice.
    """
    sides, order = [_by_training(stored), _by_training(found)], list(variants)
    keys = sorted(set().union(*sides), key=lambda key: (order.index(key[0]), int(key[1])))
    return [
        row for key in keys for row in max((side.get(key, []) for side in reversed(sides)), key=len)
    ]


def _by_training(rows: Iterable[Row]) -> dict[Training, list[Row]]:
    groups: dict[Training, dict[int, Row]] = {}
    for row in rows:
        group = groups.setdefault((row["variant"], row["seed"]), {})
        if int(row["episode"]) in group:
            raise DrlAvError(
                f"The table holds episode {row['episode']} of {row['variant']}, seed "
                f"{row['seed']}, twice: put the file back as it was made."
            )
        group[int(row["episode"])] = row
    return {key: [group[e] for e in sorted(group)] for key, group in groups.items()}


def _last_episodes(table: Table) -> dict[Training, int]:
    groups = _by_training(_stored(table))
    return {key: int(rows[-1]["episode"]) for key, rows in groups.items()}


def _progress(table: Table, goals: Sequence[Leg]) -> Progress:
    last = _last_episodes(table)
    done = [max(last.get((g.variant, str(g.seed)), 0), episodes_driven(g.folder)) for g in goals]
    return Progress(
        sum(map(min, done, (goal.stop for goal in goals))), sum(goal.stop for goal in goals)
    )


def _require_same_settings(table: Table) -> None:
    facts = read_sidecar(table.path)
    with intact(table.path):
        stored = {
            variant: stored_config(settings, str(sidecar(table.path)))
            for variant, settings in facts.get("settings", {}).items()
        }
    same = all(facts.get(name) == value for name, value in table.identity.items())
    for variant, made in stored.items():
        if made != table.configs.get(variant) or not same:
            raise DrlAvError(
                f"{table.path} holds {variant} trained with other settings: choose another folder "
                "with --out, or move the file away to train all anew."
            )


def _stored(table: Table) -> list[Row]:
    """The rows of its file, which can be merged with others; raises DrlAvError."""
    with intact(table.path):
        rows = read_rows(table.path)
        merged(rows, [], table.configs)
    return rows


def _collect(scale: Scale, table: Table, goals: Sequence[Leg]) -> None:
    """Bring table and sidecar up to date with the folders of the trainings."""
    stored = _stored(table)
    found = [row for leg in goals for row in table.rows_of(leg)]
    rows = merged(stored, found, table.configs)
    if not rows or rows == stored:
        return
    write_rows(table.path, rows)
    config = table.configs[rows[0]["variant"]]
    write_sidecar(table.path, provenance(config, **_facts(scale, table, goals)))
    with intact(table.path):
        table.written(rows)


def _facts(scale: Scale, table: Table, goals: Sequence[Leg]) -> dict[str, Any]:
    facts = read_sidecar(table.path)
    times = dict(facts.get("wall_time_s", {}))
    for leg in goals:
        if (seconds := wall_time_s(leg.clock)) is not None:
            times[leg.folder.name] = max(times.get(leg.folder.name, 0.0), round(seconds, 1))
    settings = {leg.variant: asdict(table.configs[leg.variant]) for leg in goals}
    return {
        "engine": scale.engine,
        "processes": scale.jobs,
        "seeds": sorted({leg.seed for leg in goals}),
        "wall_time_s": times,
        **table.identity,
        "settings": facts.get("settings", {}) | settings,
    }
