"""Mean speed against the number of vehicles, up to where the drivers meet (Fig. 8)."""

from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import fields
from itertools import count
from typing import Any

from drl_av.config import Config
from drl_av.drivers.registry import default_config, find_drivers
from drl_av.env.metrics import EpisodeResult
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.paired import Paired, paired
from drl_av.experiments.driven import DrivenTable
from drl_av.experiments.options import Progress, Scale
from drl_av.experiments.tables import intact, write_rows
from drl_av.files import Row, require_writable

DRIVER, BASELINES = "pretrained", ("idm", "idm-mobil", "idm-sumo")
TABLE, PAIRED = "evaluation.csv", "paired.csv"
STEP = 5
"""Vehicles by which the density rises beyond those of the published tables."""


def speeds(scale: Scale) -> Generator[Progress, None, None]:
    """Drive all drivers through the same traffic, and keep ``evaluation.csv`` up to date.

    Beyond the densities of the tables it goes on until the driver's gain on the best baseline is
    no longer certain, or the road is full. A density that the table holds already is not driven
    again.

    Raises:
        DrlAvError: as ``DrivenTable``.
    """
    choices = find_drivers([DRIVER, *BASELINES])
    config = scale.over(default_config(choices))
    table = DrivenTable(scale, TABLE, config, choices)
    require_writable(scale.out / PAIRED)
    with intact(table.path):
        list(map(episode_of, table.rows))
    done = 0
    for vehicles in _densities(config):
        cell = {"vehicles": str(vehicles)}
        for driven in table.drive(cell, config, vehicles):
            total = len(choices) * scale.drives * len({*DENSITIES, vehicles})
            yield Progress(done + driven, max(total, done), f"{vehicles} vehicles")
        done += len(table.of(cell))
        gains = paired(map(episode_of, table.rows), DRIVER, BASELINES)
        write_rows(scale.out / PAIRED, [gain.row() for gain in gains])
        here = [gain for gain in gains if gain.vehicles == vehicles]
        yield Progress(done, max(done, len(table.of(cell)) * len(DENSITIES)), "", _told(here))
        if vehicles >= max(DENSITIES) and min(g.lower_m_s for g in here if g.best) <= 0:
            return


def _densities(config: Config) -> Iterator[int]:
    """Those of the tables, and on to what the road takes."""
    from drl_av.env.highway import HighwayEnv

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


def episode_of(row: Row) -> EpisodeResult:
    """What a row of the table says; raises ValueError or LookupError where it is damaged."""
    values: dict[str, Any] = {
        item.name: row[item.name] == "True" if item.type is bool else item.type(row[item.name])  # type: ignore[operator]
        for item in fields(EpisodeResult)
    }
    return EpisodeResult(**values)
