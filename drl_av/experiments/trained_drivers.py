"""What several trainings end in: a table of their drivers' episodes in the same traffic."""

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.drivers import policy_file
from drl_av.drivers.registry import find_drivers
from drl_av.errors import RunError
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.comparison import Evaluation
from drl_av.experiments.driven import columns
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
from drl_av.experiments.tables import intact, read_rows, seeds_held, write_rows
from drl_av.files import Row, require_writable


class Cell(NamedTuple):
    """Episodes of one training's driver at one density."""

    training: str
    vehicles: str


def drive_trained(
    scale: Scale, name: str, legs: Sequence[Leg], outcome: Sequence[str]
) -> Generator[Progress, None, None]:
    """Train them all, drive each through the same traffic, and keep a table of it up to date.

    A row has the training, the vehicles and the ``outcome`` of an episode. What the table holds
    already is not driven again; a whole table is left alone.

    Raises:
        DrlAvError: as ``DrivenTable``; or the trainings' folders hold others, or have gone on.
        SimulationError: a training cannot go on.
    """
    scale.out.mkdir(parents=True, exist_ok=True)
    scale.runs.mkdir(parents=True, exist_ok=True)
    table = scale.out / name
    require_writable(table, sidecar(table))
    facts, rows = _stored(table, legs)
    by_name = {leg.folder.name: leg for leg in legs}
    cells = [Cell(training, str(n)) for training in by_name for n in DENSITIES]
    own: dict[Cell, list[Row]] = {cell: [] for cell in cells}
    for row in rows:
        own.setdefault(_cell(row), []).append(row)
    with intact(table):
        held = {cell: seeds_held(found) for cell, found in own.items()}
    missing = [cell for cell in cells if held[cell] < scale.drives]
    if not missing:
        return
    left = [by_name[training] for training in dict.fromkeys(cell.training for cell in missing)]
    yield from _trained(scale, left)
    facts = _with_trainings(facts, table, legs, left)
    driven, total = 0, sum(scale.drives - held[cell] for cell in missing)
    for cell in missing:
        choices = find_drivers([str(scale.runs / cell.training)])
        seeds = range(held[cell], scale.drives)
        config = by_name[cell.training].config
        evaluation = Evaluation(config, choices, [int(cell.vehicles)], seeds)
        with closing(evaluation.rows(scale.jobs)) as found:
            for result in found:
                rows.append(cell._asdict() | columns(result, *outcome))
                driven += 1
                yield Progress(driven, total, cell.training)
        rows.sort(key=_place)
        last = max(int(row["seed"]) for row in rows)
        made = {"processes": scale.jobs, "seeds": f"0 to {last}", **facts}
        write_sidecar(table, provenance(legs[0].config, **made))
        write_rows(table, rows)


def _stored(table: Path, legs: Sequence[Leg]) -> tuple[dict[str, Any], list[Row]]:
    """What the table holds and what made it; raises DrlAvError where that was something else."""
    configs = {leg.folder.name: leg.config for leg in legs}
    with intact(table):
        facts, rows = read_sidecar(table), read_rows(table)
        made = {
            name: stored_config(settings, str(sidecar(table)))
            for name, settings in facts.get("settings", {}).items()
        }
        rows.sort(key=_place)
        facts["wall_time_s"] = dict(facts.get("wall_time_s", {}))
        stops = {leg.folder.name: leg.stop for leg in legs} | facts.get("episodes", {})
    if any(config != configs.get(name, config) for name, config in made.items()):
        raise made_otherwise(table)
    if any(stops[leg.folder.name] != leg.stop for leg in legs):
        raise made_otherwise(table)
    return facts, rows


def _trained(scale: Scale, legs: Sequence[Leg]) -> Generator[Progress, None, None]:
    for leg in legs:
        require_same_settings(leg)
        _require_not_beyond(leg)
    total = sum(leg.stop for leg in legs)
    with closing(ENGINES[scale.engine](drive_leg, legs, scale.jobs)) as engine:
        for _ in engine:
            yield Progress(sum(episodes_driven(leg.folder) for leg in legs), total, "training")


def _require_not_beyond(leg: Leg) -> None:
    """Raise RunError where the driver of the leg's last episode has gone on learning."""
    file = leg.folder / "checkpoint.safetensors"
    done = policy_file.load(file)[1]["episodes_done"] if file.is_file() else 0
    if done > leg.stop:
        raise RunError(
            f"{leg.folder} has gone on to episode {done}, and its driver of episode {leg.stop} is "
            "gone: choose another folder with --runs."
        )


def _with_trainings(
    facts: dict[str, Any], table: Path, legs: Sequence[Leg], new: Sequence[Leg]
) -> dict[str, Any]:
    """Facts that tell of the new trainings too; raises DrlAvError where they know another one."""
    policies = {leg.folder.name: checksum(leg.policy) for leg in new}
    known = facts.get("policies_sha256", {})
    if any(known.get(name, policy) != policy for name, policy in policies.items()):
        raise made_otherwise(table)
    clocks = {leg.folder.name: wall_time_s(leg.clock) for leg in new}
    times = {name: round(seconds, 1) for name, seconds in clocks.items() if seconds is not None}
    settings = {leg.folder.name: asdict(leg.config) for leg in legs}
    return {
        "wall_time_s": facts["wall_time_s"] | times,
        "policies_sha256": known | policies,
        "episodes": facts.get("episodes", {}) | {leg.folder.name: leg.stop for leg in legs},
        "settings": facts.get("settings", {}) | settings,
    }


def _place(row: Row) -> tuple[bool, str, int, int, int]:
    """Where a row stands in the table: those of the paper's algorithm first."""
    variant, _, number = row["training"].partition("-")
    return variant != "paper", variant, int(number), int(row["vehicles"]), int(row["seed"])


def _cell(row: Row) -> Cell:
    return Cell(row["training"], row["vehicles"])
