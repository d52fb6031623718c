"""Mean speed against the number of vehicles, up to where the drivers meet (Fig. 8)."""

from collections.abc import Generator, Iterator
from contextlib import closing
from itertools import count
from pathlib import Path

from drl_av.config import Config
from drl_av.episode import EpisodeResult
from drl_av.studies import DENSITIES
from drl_av.studies.drivers import choose, config_of
from drl_av.studies.files import require_writable
from drl_av.studies.reproduction.driven import DrivenTable
from drl_av.studies.reproduction.paired import Paired, paired
from drl_av.studies.reproduction.scale import Progress, Scale
from drl_av.studies.reproduction.tables import write_rows

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
    table = DrivenTable(scale, TABLE, config, choices)
    require_writable(scale.out / PAIRED)
    done = 0
    for vehicles in _densities(config):
        for driven in table.drive(vehicles):
            total = len(choices) * scale.drives * len({*DENSITIES, vehicles})
            yield Progress(done + driven, max(total, done), f"{vehicles} vehicles")
        here = table.at(vehicles)
        done += len(here)
        _write_gains(scale.out / PAIRED, table.rows)
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


def _write_gains(file: Path, rows: list[EpisodeResult]) -> None:
    write_rows(file, [gain.row() for gain in paired(rows, DRIVER, BASELINES)])
