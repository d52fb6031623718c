"""Learning curves: Algorithm 1 with and without the check, and with another replay (Fig. 7, 9)."""

from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

from drl_av.config import Config
from drl_av.errors import DrlAvError
from drl_av.studies.files import require_writable
from drl_av.studies.reproduction.convergence import convergence
from drl_av.studies.reproduction.engines import ENGINES
from drl_av.studies.reproduction.legs import (
    Leg,
    drive_leg,
    episodes_driven,
    rows_of,
    wall_time_s,
)
from drl_av.studies.reproduction.provenance import (
    provenance,
    read_sidecar,
    sidecar,
    stored_config,
    write_sidecar,
)
from drl_av.studies.reproduction.scale import VARIANTS, Progress, Scale
from drl_av.studies.reproduction.tables import Row, read_rows, write_rows

CHANGES: dict[str, dict[str, dict[str, Any]]] = {
    "paper": {},
    "permit_all": {"safety": {"check": "permit_all"}},
    "prioritized": {"learning": {"replay": "prioritized"}},
}
"""What each variant changes in the config."""
TABLE, SUMMARY = "curves.csv", "convergence.csv"
Training = tuple[str, int]
"""A variant and a seed."""


def curves(scale: Scale) -> Generator[Progress, None, None]:
    """Train every variant on every seed, and keep ``curves.csv`` up to date.

    What the table holds already, made with the same settings, is not trained again, whether or
    not the folders of those trainings are still there.

    Raises:
        DrlAvError: the table was made with other settings, or the disk refuses.
        RunError, SimulationError: a training cannot go on.
    """
    table = scale.out / TABLE
    scale.out.mkdir(parents=True, exist_ok=True)
    scale.runs.mkdir(parents=True, exist_ok=True)
    for file in (table, sidecar(table)):
        require_writable(file)
    _require_same_settings(scale, table)
    goals = _legs(scale)
    _collect(scale, goals, table)
    yield _progress(goals, table)
    for round_ in _rounds(goals, scale.episodes):
        missing = _missing(round_, table)
        try:
            with closing(ENGINES[scale.engine](drive_leg, missing, scale.jobs)) as engine:
                for ended in engine:
                    if ended:
                        _collect(scale, goals, table)
                    yield _progress(goals, table)
        finally:
            _collect(scale, goals, table)


def variant_config(base: Config, variant: str, seed: int = 0) -> Config:
    """The settings of one training; raises ConfigError."""
    for section, settings in CHANGES[variant].items():
        base = base.updated(section, **settings)
    return base.updated("learning", seed=seed)


def merged(stored: Iterable[Row], found: Iterable[Row]) -> list[Row]:
    """Each training's rows from the side that got further with it, every episode once.

    Raises:
        DrlAvError: a side holds an episode of a training twice.
    """
    sides = [_by_training(stored), _by_training(found)]
    trainings = sorted(set().union(*sides), key=lambda key: (VARIANTS.index(key[0]), key[1]))
    return [
        row
        for training in trainings
        for row in max((side.get(training, []) for side in reversed(sides)), key=len)
    ]


def _by_training(rows: Iterable[Row]) -> dict[Training, list[Row]]:
    groups: dict[Training, dict[int, Row]] = {}
    for row in rows:
        training, episode = (row["variant"], int(row["seed"])), int(row["episode"])
        if episode in groups.setdefault(training, {}):
            raise DrlAvError(
                f"{TABLE} holds episode {episode} of {training[0]}, seed {training[1]}, twice: "
                "put the file back as it was made."
            )
        groups[training][episode] = row
    return {key: [group[e] for e in sorted(group)] for key, group in groups.items()}


def _legs(scale: Scale) -> list[Leg]:
    """Every training with the last episode that is asked of it."""
    config = scale.over(Config())
    schedule = config.learning.episodes
    return [
        Leg(
            variant,
            seed,
            schedule if seed < scale.full_seeds else min(scale.episodes, schedule),
            variant_config(config, variant, seed),
            scale.runs / f"{variant}-{seed}",
        )
        for seed, variant in product(range(scale.seeds), scale.variants)
    ]


def _rounds(goals: Sequence[Leg], episodes: int) -> list[list[Leg]]:
    """First all of them as far as the shorter ones go, then those that go on."""
    return [
        [leg._replace(stop=min(leg.stop, episodes)) for leg in goals],
        [leg for leg in goals if leg.stop > episodes],
    ]


def _missing(legs: Iterable[Leg], table: Path) -> list[Leg]:
    last = _last_episodes(table)
    return [leg for leg in legs if last.get((leg.variant, leg.seed), 0) < _last_evaluation(leg)]


def _last_episodes(table: Path) -> dict[Training, int]:
    return {k: int(rows[-1]["episode"]) for k, rows in _by_training(read_rows(table)).items()}


def _last_evaluation(leg: Leg) -> int:
    every = leg.config.learning.evaluate_every
    return leg.stop if leg.stop == leg.config.learning.episodes else leg.stop // every * every


def _progress(goals: Sequence[Leg], table: Path) -> Progress:
    last = _last_episodes(table)
    done = sum(
        min(leg.stop, max(last.get((leg.variant, leg.seed), 0), episodes_driven(leg.folder)))
        for leg in goals
    )
    return Progress(done, sum(leg.stop for leg in goals), "episodes")


def _require_same_settings(scale: Scale, table: Path) -> None:
    config = scale.over(Config())
    for variant, settings in read_sidecar(table).get("settings", {}).items():
        made = stored_config(settings, str(sidecar(table)))
        if variant not in VARIANTS or made != variant_config(config, variant):
            raise DrlAvError(
                f"{table} holds {variant} trained with other settings: choose another folder "
                "with --out, or move the file away to train all anew."
            )


def _collect(scale: Scale, goals: Sequence[Leg], table: Path) -> None:
    """Bring table and sidecar up to date with the folders of the trainings."""
    stored = read_rows(table)
    found = [row for leg in goals for row in rows_of(leg)]
    rows = merged(stored, found)
    if not rows or rows == stored:
        return
    write_rows(table, rows)
    config = scale.over(Config())
    each = config.learning.evaluation_episodes
    write_rows(table.with_name(SUMMARY), convergence(rows, each))
    facts = read_sidecar(table)
    write_sidecar(table, provenance(config, **_facts(scale, goals, facts)))


def _facts(scale: Scale, goals: Sequence[Leg], facts: dict[str, Any]) -> dict[str, Any]:
    times = dict(facts.get("wall_time_s", {}))
    for leg in goals:
        if (seconds := wall_time_s(leg.clock)) is not None:
            times[leg.folder.name] = max(times.get(leg.folder.name, 0.0), round(seconds, 1))
    config = scale.over(Config())
    configs = {variant: variant_config(config, variant) for variant in scale.variants}
    return {
        "engine": scale.engine,
        "processes": scale.jobs,
        "seeds": f"0 to {scale.seeds - 1}",
        "wall_time_s": times,
        "settings": facts.get("settings", {}) | {k: asdict(v) for k, v in configs.items()},
    }
