"""What the check ``strict`` costs the shipped driver, and what each of its bounds does (ours)."""

from collections import Counter
from collections.abc import Generator
from contextlib import closing
from dataclasses import asdict
from time import monotonic
from typing import NamedTuple

from drl_av.config import Config
from drl_av.studies import DENSITIES
from drl_av.studies.drivers import PRETRAINED, choose, config_of, policy_file
from drl_av.studies.evaluation import Evaluation
from drl_av.studies.files import require_writable
from drl_av.studies.reproduction.provenance import (
    checksum,
    provenance,
    read_sidecar,
    sidecar,
    stored_config,
    write_sidecar,
)
from drl_av.studies.reproduction.scale import Progress, Scale
from drl_av.studies.reproduction.tables import Row, intact, read_rows, write_rows

TABLE = "strict.csv"
VEHICLES = 15
"""Density at which the bounds are moved, one at a time."""
BOUNDS: dict[str, tuple[float, ...]] = {
    "braking_m_s2": (6.0, 9.0),
    "acceleration_m_s2": (4.0,),
    "lateral_speed_m_s": (1.52,),
    "follower_response_s": (1.0,),
    "follower_braking_m_s2": (3.0,),
    "clearance_m": (0.0, 2.0),
}
"""Other values of each bound than its default, which is what our traffic does."""


class Cell(NamedTuple):
    """Episodes under one check at one density."""

    check: str
    bound: str
    """The bound of ``strict`` that was moved; empty for none."""
    value: str
    vehicles: int

    def config(self, base: Config) -> Config:
        """The settings it is driven with."""
        base = base.updated("safety", check=self.check)
        if not self.bound:
            return base
        return base.updated("strict", **{self.bound: float(self.value)})


def cells() -> list[Cell]:
    """All of them: both checks at every density, then each bound moved."""
    checks = [Cell(check, "", "", n) for n in DENSITIES for check in ("paper", "strict")]
    moved = [
        Cell("strict", bound, f"{value:g}", VEHICLES)
        for bound, values in BOUNDS.items()
        for value in values
    ]
    return checks + moved


def strictness(scale: Scale) -> Generator[Progress, None, None]:
    """Drive the shipped driver under both checks, and keep ``strict.csv`` up to date.

    A cell that the table holds already, made with the same settings and policy, is not driven
    again.

    Raises:
        DrlAvError: as ``Evaluation``; or the disk refuses.
    """
    choices = choose(["pretrained"])
    config = scale.over(config_of(choices))
    scale.out.mkdir(parents=True, exist_ok=True)
    table = scale.out / TABLE
    require_writable(table, sidecar(table))
    policy = checksum(policy_file(PRETRAINED))
    with intact(table):
        facts = read_sidecar(table)
        same = facts.get("policy_sha256") == policy
        same = same and stored_config(facts["settings"], str(sidecar(table))) == config
        rows, spent_s = (read_rows(table), float(facts["wall_time_s"])) if same else ([], 0.0)
        held = Counter(map(_cell, rows))
    total = len(cells()) * scale.drives
    for done, cell in enumerate(cells()):
        if held[cell] >= scale.drives:
            continue
        begun_s, here = monotonic(), []
        evaluation = Evaluation(cell.config(config), choices, [cell.vehicles], range(scale.drives))
        with closing(evaluation.rows(scale.jobs)) as found:
            for result in found:
                outcome = {
                    "seed": str(result.seed),
                    "mean_speed_m_s": repr(result.mean_speed_m_s),
                    "collided": str(result.collided),
                    "ego_hit": str(result.ego_hit),
                    "safety_triggers": str(result.safety_triggers),
                }
                here.append({**cell._asdict(), "vehicles": str(cell.vehicles), **outcome})
                told = f"{cell.check} {cell.bound} {cell.value}".strip()
                yield Progress(done * scale.drives + len(here), total, told)
        spent_s += monotonic() - begun_s
        rows = [*(row for row in rows if _cell(row) != cell), *here]
        write_rows(table, rows)
        made = provenance(
            config,
            processes=scale.jobs,
            seeds=f"0 to {scale.drives - 1}",
            wall_time_s=round(spent_s, 1),
            policy_sha256=policy,
            settings=asdict(config),
        )
        write_sidecar(table, made)


def _cell(row: Row) -> Cell:
    return Cell(row["check"], row["bound"], row["value"], int(row["vehicles"]))
