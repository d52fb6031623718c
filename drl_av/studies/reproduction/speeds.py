"""Mean speed against the number of vehicles, up to where the drivers meet (Fig. 8)."""

from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import asdict, fields
from itertools import count
from pathlib import Path
from time import monotonic
from typing import Any

from drl_av.config import Config
from drl_av.episode import EpisodeResult
from drl_av.studies import DENSITIES
from drl_av.studies.drivers import PRETRAINED, choose, config_of, policy_file
from drl_av.studies.evaluation import Evaluation, write_rows
from drl_av.studies.files import require_writable
from drl_av.studies.reproduction import tables
from drl_av.studies.reproduction.paired import Paired, paired
from drl_av.studies.reproduction.provenance import (
    checksum,
    provenance,
    read_sidecar,
    sidecar,
    stored_config,
    write_sidecar,
)
from drl_av.studies.reproduction.scale import Progress, Scale

DRIVER, BASELINES = "pretrained", ("idm", "idm-mobil", "idm-sumo")
TABLE, PAIRED = "evaluation.csv", "paired.csv"
STEP = 5
"""Vehicles by which the density rises beyond those of the published tables."""


def speeds(scale: Scale) -> Generator[Progress, None, None]:
    """Drive all drivers through the same traffic, and keep ``evaluation.csv`` up to date.

    Beyond the densities of the tables it goes on until the driver's gain on the best baseline is
    no longer certain, or the road is full. A density that the table holds already, made with the
    same settings and policy, is not driven again.

    Raises:
        DrlAvError: as ``Evaluation``; or the disk refuses.
    """
    choices = choose([DRIVER, *BASELINES])
    config = scale.over(config_of(choices))
    scale.out.mkdir(parents=True, exist_ok=True)
    table = scale.out / TABLE
    require_writable(table, sidecar(table), scale.out / PAIRED)
    with tables.intact(table):
        rows, spent_s = _kept(table, config)
    done = 0
    for vehicles in _densities(config):
        evaluation = Evaluation(config, choices, [vehicles], range(scale.drives))
        here = [r for r in rows if r.vehicles == vehicles and r.seed < scale.drives]
        if len(here) < len(evaluation):
            begun_s, here = monotonic(), []
            with closing(evaluation.rows(scale.jobs)) as found:
                for row in found:
                    here.append(row)
                    total = len(evaluation) * len({*DENSITIES, vehicles})
                    yield Progress(done + len(here), max(total, done), f"{vehicles} vehicles")
            spent_s += monotonic() - begun_s
            rows = [*(r for r in rows if r.vehicles != vehicles), *here]
            rows.sort(key=lambda row: row.vehicles)
            write_rows(table, rows)
            write_sidecar(table, _facts(scale, config, spent_s))
        done += len(here)
        _write_gains(scale.out / PAIRED, rows)
        gains = paired(here, DRIVER, BASELINES)
        yield Progress(done, max(done, len(here) * len(DENSITIES)), "", _told(gains))
        if vehicles >= max(DENSITIES) and min(g.lower_m_s for g in gains if g.best) <= 0:
            return


def _densities(config: Config) -> Iterator[int]:
    """Those of the tables, and on to what the road takes."""
    from drl_av.env import HighwayEnv

    with closing(HighwayEnv(config=config)) as env:
        most = env.simulation.capacity
    yield from DENSITIES
    for vehicles in count(max(DENSITIES) + STEP, STEP):
        if vehicles > most:
            return
        yield vehicles


def _told(gains: list[Paired]) -> str:
    cells = [
        f"{gain.difference_m_s} on {gain.baseline}{' (best)' if gain.best else ''}"
        for gain in gains
    ]
    return f"{gains[0].vehicles} vehicles: {gains[0].driver} gains {', '.join(cells)}, m/s"


def _kept(table: Path, config: Config) -> tuple[list[EpisodeResult], float]:
    """What an earlier command left that still holds, and the seconds spent on it."""
    facts = read_sidecar(table)
    if not facts or facts.get("policy_sha256") != checksum(policy_file(PRETRAINED)):
        return [], 0.0
    if stored_config(facts["settings"], str(sidecar(table))) != config:
        return [], 0.0
    return [_result(row) for row in tables.read_rows(table)], float(facts["wall_time_s"])


def _result(row: tables.Row) -> EpisodeResult:
    values: dict[str, Any] = {
        item.name: row[item.name] == "True" if item.type is bool else item.type(row[item.name])  # type: ignore[operator]
        for item in fields(EpisodeResult)
    }
    return EpisodeResult(**values)


def _write_gains(file: Path, rows: list[EpisodeResult]) -> None:
    tables.write_rows(file, [gain.row() for gain in paired(rows, DRIVER, BASELINES)])


def _facts(scale: Scale, config: Config, spent_s: float) -> dict[str, Any]:
    return provenance(
        config,
        processes=scale.jobs,
        seeds=f"0 to {scale.drives - 1}",
        wall_time_s=round(spent_s, 1),
        policy_sha256=checksum(policy_file(PRETRAINED)),
        settings=asdict(config),
    )
