"""Trainings spread over processes, and one table of what they brought, each episode once."""

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.config import Config
from drl_av.errors import DrlAvError
from drl_av.experiments.engines import ENGINES
from drl_av.experiments.legs import (
    Leg,
    drive_leg,
    episodes_driven,
    require_same_settings,
    wall_time_s,
)
from drl_av.experiments.options import Progress, Scale
from drl_av.experiments.provenance import (
    checksum,
    made_otherwise,
    provenance,
    read_sidecar,
    sidecar,
    stored_config,
    write_sidecar,
)
from drl_av.experiments.tables import intact, read_rows, write_rows
from drl_av.files import Row, require_writable

Training = tuple[str, str]
"""A variant and a seed."""


class Table(NamedTuple):
    """Where the rows of some trainings go, and how they are made."""

    path: Path
    configs: Mapping[str, Config]
    """The settings of every variant, with seed 0, and of what they begin from."""
    rows_of: Callable[[Leg], list[Row]]
    written: Callable[[list[Row]], None] = lambda rows: None
    """Called with the rows whenever they were looked at."""


def trained(
    scale: Scale, table: Table, rounds: Sequence[Sequence[Leg]]
) -> Generator[Progress, None, None]:
    """Drive the legs of each round, and keep the table up to date.

    What the table holds already is not trained again, whether or not the folders of those
    trainings are still there. What a leg begins from is trained first.

    Raises:
        DrlAvError: the table was made with other settings, the disk refuses, or the episodes are
            fewer than a row sums up.
        RunError, SimulationError: a training cannot go on.
    """
    table.path.parent.mkdir(parents=True, exist_ok=True)
    scale.runs.mkdir(parents=True, exist_ok=True)
    require_writable(table.path, sidecar(table.path))
    _require_same_settings(table)
    goals = list({leg.folder: leg for legs in rounds for leg in legs}.values())
    for leg in goals:
        if leg.last_row < 1:
            raise DrlAvError(
                f"{leg.stop} episodes make no row of {table.path.name}, which sums up "
                f"{leg.every}: ask for as many at the least."
            )
    last = _last_episodes(_stored(table))
    goals_left = _left(last, goals)
    for leg in goals_left:
        require_same_settings(leg)
    _require_same_origins(table, goals_left)
    last = _collect(scale, table, goals_left)
    yield _progress(last, goals)
    for legs in rounds:
        left = _left(last, legs)
        origins = {leg.origin.folder: leg.origin for leg in left if leg.origin and not leg.begun}
        try:
            for jobs in filter(None, (list(origins.values()), left)):
                with closing(ENGINES[scale.engine](drive_leg, jobs, scale.jobs)) as engine:
                    for ended in engine:
                        if ended:
                            last = _collect(scale, table, goals_left)
                        yield _progress(last, [*origins.values(), *goals])
                _require_same_origins(table, left)
        finally:
            last = _collect(scale, table, goals_left)
    for leg in _left(last, goals):
        raise DrlAvError(
            f"{leg.folder} lacks rows of its training up to episode {leg.last_row}: put back its "
            "files, or give --runs a folder that all processes share."
        )


def _left(last: Mapping[Training, int], legs: Iterable[Leg]) -> list[Leg]:
    """Those that have not brought all their rows."""
    return [leg for leg in legs if _last_row(last, leg) < leg.last_row]


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


def _last_row(last: Mapping[Training, int], leg: Leg) -> int:
    return last.get((leg.variant, str(leg.seed)), 0)


def _progress(last: Mapping[Training, int], legs: Sequence[Leg]) -> Progress:
    """Episodes in the table, and those since then of the trainings that are under way."""
    done = 0
    for leg in legs:
        held = _last_row(last, leg)
        done += min(max(held, episodes_driven(leg.folder) if held < leg.stop else 0), leg.stop)
    return Progress(done, sum(leg.stop for leg in legs))


def _require_same_settings(table: Table) -> None:
    """The table's, where there is one."""
    with intact(table.path):
        stored = {
            variant: stored_config(settings, str(sidecar(table.path)))
            for variant, settings in read_sidecar(table.path).get("settings", {}).items()
        }
    if stored and stored != dict(table.configs):
        raise made_otherwise(table.path)


def _require_same_origins(table: Table, legs: Iterable[Leg]) -> None:
    """The table's, where it has legs of those origins."""
    stored, found = read_sidecar(table.path).get("policies_sha256", {}), _policies(legs)
    if any(found.get(name, policy) != policy for name, policy in stored.items()):
        raise made_otherwise(table.path)


def _policies(legs: Iterable[Leg]) -> dict[str, str]:
    """Whose drivers go on learning: checksums of those that are there."""
    origins = {leg.origin.folder.name: leg.origin for leg in legs if leg.origin}
    return {name: checksum(leg.policy) for name, leg in origins.items() if leg.policy.is_file()}


def _stored(table: Table) -> list[Row]:
    """The rows of its file, which can be merged with others; raises DrlAvError."""
    with intact(table.path):
        rows = read_rows(table.path)
        merged(rows, [], table.configs)
    return rows


def _last_episodes(rows: Iterable[Row]) -> dict[Training, int]:
    return {key: int(own[-1]["episode"]) for key, own in _by_training(rows).items()}


def _collect(scale: Scale, table: Table, legs: Sequence[Leg]) -> dict[Training, int]:
    """Bring table and sidecar up to date with the trainings' folders; each one's last episode."""
    stored = _stored(table)
    rows = merged(stored, [row for leg in legs for row in table.rows_of(leg)], table.configs)
    if rows != stored:
        config = table.configs[rows[0]["variant"]]
        write_sidecar(table.path, provenance(config, **_facts(scale, table, legs, rows)))
        write_rows(table.path, rows)
    if rows:
        with intact(table.path):
            table.written(rows)
    return _last_episodes(rows)


def _facts(scale: Scale, table: Table, legs: Sequence[Leg], rows: Sequence[Row]) -> dict[str, Any]:
    facts = read_sidecar(table.path)
    with intact(table.path):
        times = {name: float(seconds) for name, seconds in facts.get("wall_time_s", {}).items()}
    for leg in legs:
        if (seconds := wall_time_s(leg.clock)) is not None:
            times[leg.folder.name] = max(times.get(leg.folder.name, 0.0), round(seconds, 1))
    policies = facts.get("policies_sha256", {}) | _policies(legs)
    return {
        "engine": scale.engine,
        "processes": scale.jobs,
        "seeds": sorted({int(row["seed"]) for row in rows}),
        "wall_time_s": times,
        **({"policies_sha256": policies} if policies else {}),
        "settings": {variant: asdict(config) for variant, config in table.configs.items()},
    }
