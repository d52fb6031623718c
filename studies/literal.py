"""The experiment ``literal``: the effect of each point in which drl-av deviates from the paper."""

from collections.abc import Mapping
from itertools import product
from operator import itemgetter
from typing import Any

from drl_av.config import Config
from drl_av.config.presets import LITERAL
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.statistics import grouped, mean_difference
from studies.cells import Drives, policies_of
from studies.density_sweep import DRIVER
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import count, markdown_table, mean_of, values_by_traffic
from studies.options import ReproduceOptions
from studies.plan import Plan, by
from studies.store import MadeWith

DRIVERS = (DRIVER, "idm", "idm-mobil")
EPISODES = 15
"""Largest number of episodes of each driver at each number of vehicles with each variant."""
Settings = Mapping[str, Mapping[str, Any]]
EXACT = {"speed_tolerance_m_s": 0.0}
VARIANTS: dict[str, Settings] = {
    "ours": {},
    "rule 1": {"safety": {"printed_rule_1": True}},
    "rule 3": {"safety": {"printed_rule_3": True}},
    "IDM rule": {"safety": {"printed_idm": True}},
    "exact v_des": {"reward": EXACT},
    "v_des of the best lane": {"reward": {**EXACT, "desired": "best-lane"}},
    "literal": LITERAL,
}
"""The settings of each variant, by section; all others are those of the shipped driver.

The variant with the v_des of the best lane also has the exact v_des.
"""


def literal_plan(options: ReproduceOptions) -> Plan:
    """Return a plan to evaluate every driver with each variant's settings, on the same seeds."""
    base = options.settings_of([DRIVER])
    configs = {name: changed(base, settings) for name, settings in VARIANTS.items()}
    seeds = min(options.drives, EPISODES)
    cells = [
        Drives(config, DRIVERS, vehicles, seeds, named=(("variant", name),))
        for vehicles in DENSITIES
        for name, config in configs.items()
    ]
    order = by(vehicles=int, seed=int, variant=VARIANTS, driver=DRIVERS)
    return Plan(MadeWith(configs, policies_of([DRIVER])), [cells], order)


def changed(config: Config, settings: Settings) -> Config:
    """Return the config with the settings of a variant."""
    for section, values in settings.items():
        config = config.updated(section, **values)
    return config


def literal_table(results: ResultsFolder) -> str:
    """Return the Markdown table of each driver's results with each variant, over all densities.

    The change of the speed from the first variant is paired by traffic, with its 95 % interval.
    """
    driven = grouped(results.rows(LITERAL_PAPER.table), itemgetter("driver", "variant"))
    lines = []
    for driver, variant in product(DRIVERS, VARIANTS):
        rows = driven[driver, variant]
        own = values_by_traffic(rows)
        plain = values_by_traffic(driven[driver, next(iter(VARIANTS))])
        cells = [
            f"{mean_of(rows, 'mean_speed_m_s'):.2f}",
            str(mean_difference(own, plain, f"{driver} with {variant} and without")),
            f"{mean_of(rows, 'mean_reward'):.3f}",
            f"{mean_of(rows, 'safety_triggers'):.1f}",
            f"{count(rows, 'ego_hit')} of {len(rows)}",
        ]
        lines.append([f"`{driver}`", variant, *cells])
    names = ("driver", "as printed", "mean speed, m/s", "change, m/s", "reward per decision")
    return markdown_table([*names, "actions replaced", "ego hit something"], lines)


LITERAL_PAPER = Experiment(
    name="literal",
    meaning="the shipped driver and two baselines with each point of the paper as printed",
    row="an episode of a driver with a variant of the settings",
    plan=literal_plan,
    summaries={"literal": literal_table},
)
