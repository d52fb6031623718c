"""What the check ``strict`` costs the shipped driver, and what each of its bounds does (ours)."""

from collections.abc import Generator
from functools import partial
from typing import NamedTuple

from drl_av.config import Config
from drl_av.drivers.registry import default_config, find_drivers
from drl_av.env.metrics import EpisodeResult
from drl_av.evaluation import DENSITIES
from drl_av.experiments.driven import DrivenTable, columns
from drl_av.experiments.options import Progress, Scale
from drl_av.files import Row

TABLE = "strict.csv"
OUTCOME = ("seed", "mean_speed_m_s", "collided", "ego_hit", "safety_triggers")
"""What is kept of an episode."""
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

    def row(self) -> Row:
        """What its rows have in common."""
        return {**self._asdict(), "vehicles": str(self.vehicles)}

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

    A cell that the table holds already is not driven again.

    Raises:
        DrlAvError: as ``DrivenTable``.
    """
    choices = find_drivers(["pretrained"])
    config = scale.over(default_config(choices))
    table = DrivenTable(scale, TABLE, config, choices)
    total = len(cells()) * scale.drives
    for done, cell in enumerate(cells()):
        own = cell.config(config)
        for driven in table.drive(cell.row(), own, cell.vehicles, partial(_row, cell)):
            told = f"{cell.check} {cell.bound} {cell.value}".strip()
            yield Progress(done * scale.drives + driven, total, told)


def _row(cell: Cell, result: EpisodeResult) -> Row:
    return cell.row() | columns(result, *OUTCOME)
