"""The drivers of the mean speeds in other settings than theirs."""

from collections.abc import Generator
from typing import Any, NamedTuple

from drl_av.config import Config
from drl_av.drivers.registry import default_config, find_drivers
from drl_av.evaluation import DENSITIES
from drl_av.experiments.barricade_training import SCENARIO, TRAINED_VEHICLES
from drl_av.experiments.density_sweep import BASELINES, DRIVER
from drl_av.experiments.driven import DrivenTable
from drl_av.experiments.options import Progress, Scale


class Variation(NamedTuple):
    """Some drivers in settings of their own."""

    table: str
    drivers: tuple[str, ...]
    section: str
    settings: dict[str, Any]
    """What differs in that section of the config."""
    densities: tuple[int, ...] = DENSITIES

    def over(self, config: Config) -> Config:
        """The settings it is driven with."""
        return config.updated(self.section, **self.settings)


CATCH_UP = {
    "longitudinal_reference": "acc",
    "acc_gap_gain_per_s": 1 / Config().reward.catch_up_time_s,
    "reference_standstill_gap_m": 0.0,
}
"""Adaptive cruise control at the pace of the reward's v_des, that follows at d_safe (ours)."""
VARIATIONS = (
    Variation("check_paper.csv", ("random",), "safety", {"check": "paper"}),
    Variation("check_permit_all.csv", ("random", "idm-sumo"), "safety", {"check": "permit_all"}),
    Variation("reference_acc.csv", (DRIVER, *BASELINES), "ego", CATCH_UP),
    Variation("exact_speed.csv", (DRIVER,), "reward", {"speed_tolerance_m_s": 0.0}),
    Variation(
        "barricade_pretrained.csv",
        (DRIVER,),
        "simulation",
        {"scenario": SCENARIO},
        (TRAINED_VEHICLES,),
    ),
)


def variations(scale: Scale) -> Generator[Progress, None, None]:
    """Drive each of them, and keep its table up to date.

    A density that a table holds already is not driven again.

    Raises:
        DrlAvError: as ``DrivenTable``.
    """
    tables = []
    for variation in VARIATIONS:
        choices = find_drivers(variation.drivers)
        config = variation.over(scale.over(default_config(choices)))
        tables.append(DrivenTable(scale, variation.table, config, choices))
    total = sum(len(v.densities) * len(v.drivers) for v in VARIATIONS) * scale.drives
    done = 0
    for variation, table in zip(VARIATIONS, tables, strict=True):
        for vehicles in variation.densities:
            for driven in table.drive({"vehicles": str(vehicles)}, table.config, vehicles):
                yield Progress(done + driven, total, variation.table)
            done += len(variation.drivers) * scale.drives
