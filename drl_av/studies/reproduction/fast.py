"""The preset ``fast`` on several seeds, beside the driver of the paper's whole schedule (ours)."""

from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.config import Config
from drl_av.presets import preset
from drl_av.studies import DENSITIES
from drl_av.studies.drivers import choose
from drl_av.studies.evaluation import Evaluation
from drl_av.studies.files import require_writable
from drl_av.studies.reproduction.curves import variant_config
from drl_av.studies.reproduction.driven import columns
from drl_av.studies.reproduction.engines import ENGINES
from drl_av.studies.reproduction.legs import (
    Leg,
    drive_leg,
    episodes_driven,
    require_same_settings,
    wall_time_s,
)
from drl_av.studies.reproduction.provenance import (
    checksum,
    made_otherwise,
    provenance,
    read_sidecar,
    sidecar,
    stored_config,
    write_sidecar,
)
from drl_av.studies.reproduction.scale import Progress, Scale
from drl_av.studies.reproduction.tables import Row, intact, read_rows, write_rows

TABLE = "fast.csv"
OUTCOME = ("seed", "mean_reward", "mean_speed_m_s", "ego_hit")
"""What is kept of an episode."""


class Cell(NamedTuple):
    """Episodes of one training's driver at one density."""

    training: str
    vehicles: str


def fast(scale: Scale) -> Generator[Progress, None, None]:
    """Train both, drive all through the same traffic, and keep ``fast.csv`` up to date.

    The long training is that of the learning curves, seed 0, and goes on from there. What the
    table holds already is not driven again; a whole table is left alone.

    Raises:
        DrlAvError: as ``DrivenTable``; or the trainings' folders hold others.
        SimulationError: a training cannot go on.
    """
    scale.out.mkdir(parents=True, exist_ok=True)
    scale.runs.mkdir(parents=True, exist_ok=True)
    table, legs = scale.out / TABLE, _legs(scale)
    require_writable(table, sidecar(table))
    facts, rows = _stored(table, legs)
    held = Counter(map(_cell, rows))
    cells = [Cell(leg.folder.name, str(n)) for leg in legs for n in DENSITIES]
    missing = [cell for cell in cells if held[cell] < scale.drives]
    if not missing:
        return
    left = [leg for leg in legs if leg.folder.name in {cell.training for cell in missing}]
    yield from _trained(scale, left)
    facts = _with_trainings(facts, table, legs, left)
    driven, total = 0, sum(scale.drives - held[cell] for cell in missing)
    for cell in missing:
        choices = choose([str(scale.runs / cell.training)])
        seeds = range(held[cell], scale.drives)
        evaluation = Evaluation(legs[0].config, choices, [int(cell.vehicles)], seeds)
        with closing(evaluation.rows(scale.jobs)) as found:
            for result in found:
                rows.append(cell._asdict() | columns(result, *OUTCOME))
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
    if any(config != configs.get(name, config) for name, config in made.items()):
        raise made_otherwise(table)
    return facts, rows


def _trained(scale: Scale, legs: Sequence[Leg]) -> Generator[Progress, None, None]:
    for leg in legs:
        require_same_settings(leg)
    total = sum(leg.stop for leg in legs)
    with closing(ENGINES[scale.engine](drive_leg, legs, scale.jobs)) as engine:
        for _ in engine:
            yield Progress(sum(episodes_driven(leg.folder) for leg in legs), total, "training")


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
        "wall_time_s": facts.get("wall_time_s", {}) | times,
        "policies_sha256": known | policies,
        "settings": facts.get("settings", {}) | settings,
    }


def _place(row: Row) -> tuple[bool, int, int, int]:
    """Where a row stands in the table: those of the long training first."""
    variant, _, number = row["training"].partition("-")
    return variant != "paper", int(number), int(row["vehicles"]), int(row["seed"])


def _cell(row: Row) -> Cell:
    return Cell(row["training"], row["vehicles"])


def _legs(scale: Scale) -> list[Leg]:
    """The long training first, then ``fast`` on every seed."""
    long = variant_config(scale.over(Config()), "paper")
    short = scale.over(preset("fast"))
    configs = {"paper-0": long} | {
        f"fast-{seed}": short.updated("learning", seed=seed) for seed in range(scale.seeds)
    }
    return [_leg(scale.runs / name, config) for name, config in configs.items()]


def _leg(folder: Path, config: Config) -> Leg:
    learning, variant = config.learning, folder.name.partition("-")[0]
    episodes, every = learning.episodes, learning.evaluate_every
    return Leg(variant, learning.seed, episodes, config, folder, every)
