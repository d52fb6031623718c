"""Compares our drivers with the strongest rule-based ones, in each kind of traffic (ours)."""

from collections.abc import Iterable
from operator import itemgetter
from statistics import fmean
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from drl_av.config import SINGLE_PRESETS, Config
from drl_av.evaluation.aggregates import interquartile_mean, probability_of_improvement
from drl_av.evaluation.figure_style import label_axes, legend_of_names, panels
from drl_av.evaluation.statistics import Mean, grouped, mean_difference
from drl_av.files import Row
from studies.cells import Drives, policies_of
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import (
    collisions_cell,
    markdown_table,
    mean_of,
    rows_by_density,
    values_by_traffic,
)
from studies.options import ReproduceOptions
from studies.plan import Plan
from studies.store import MadeWith

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VEHICLES = (1, 5, 10, 15, 20, 25, 30, 40)
MIDDLE = range(5, 26)
"""The numbers of vehicles over which the gains are also pooled."""
POOLED = f"{min(MIDDLE)} to {max(MIDDLE)}"
FIRST_SEED = 910_000
LEARNED = ("pretrained", "pretrained-smooth")
OURS = (*LEARNED, "planner")
OPPONENTS = ("gap-mobil", "gap-mobil-1.3", "sumo", "sumo-tuned")
COLUMNS = (
    "driver",
    "safety_check",
    "seed",
    "mean_speed_m_s",
    "collided",
    "ego_hit",
    "lane_changes",
    "aborted_lane_changes",
)
REFERENCE = "gap-mobil"
"""The driver to which the figure compares the others."""
STRICT_RULE = f"{REFERENCE}, strict"
"""The label of this driver under the check ``strict``."""
Speeds = dict[tuple[str, str], float]
"""The mean speeds of a driver, m/s, by number of vehicles and traffic seed."""


class Variant(NamedTuple):
    """The drivers that drive with one check and one longitudinal reference."""

    drivers: tuple[str, ...]
    check: str = "paper"
    reference: str = "acceleration"
    setting: str = ""
    """Text that the tables append to the names of the drivers; empty for none."""
    episodes: int = 100
    """Largest number of episodes at each number of vehicles in each kind of traffic."""

    def config(self, config: Config, kind: str) -> Config:
        """Return the config of this variant in a kind of traffic."""
        config = config.updated("safety", check=self.check)
        return config.updated("ego", longitudinal_reference=self.reference).with_traffic(kind)


VARIANTS = {
    "paper": Variant(("pretrained", *OPPONENTS)),
    "acc": Variant(("idm-mobil", "idm-sumo"), reference="acc", setting="acc"),
    "strict": Variant(("pretrained",), check="strict", setting="strict", episodes=250),
    "smooth": Variant(("pretrained-smooth",), check="strict", setting="strict", episodes=250),
    "rule": Variant(("gap-mobil",), check="strict", setting="strict"),
    "search": Variant(("planner",), episodes=50),
    "search_strict": Variant(("planner",), check="strict", setting="strict", episodes=250),
}
"""The variants by name. ``planner`` under ``paper`` drives fewer episodes, as it is the slowest
to compute; three drivers under ``strict`` drive more, so that rare hits are seen."""
PLACES = [(name, driver) for name, each in VARIANTS.items() for driver in each.drivers]


def opponents_plan(options: ReproduceOptions) -> Plan:
    """Return a plan to evaluate every variant's drivers in each kind of traffic.

    All traffic seeds begin at ``FIRST_SEED``; their number may differ between variants.
    """
    bases = {
        name: options.settings_of([one for one in variant.drivers if one in LEARNED] or LEARNED[:1])
        for name, variant in VARIANTS.items()
    }
    configs = {
        (kind, name): variant.config(bases[name], kind)
        for kind in SINGLE_PRESETS
        for name, variant in VARIANTS.items()
    }
    cells = [
        Drives(
            config,
            variant.drivers,
            vehicles,
            min(options.drives, variant.episodes),
            COLUMNS,
            named=(("traffic", kind), ("variant", name)),
            first_seed=FIRST_SEED,
        )
        for vehicles in VEHICLES
        for (kind, name), config in configs.items()
        for variant in (VARIANTS[name],)
    ]
    settings = {f"{kind}, {name}": config for (kind, name), config in configs.items()}
    return Plan(MadeWith(settings, policies_of(LEARNED)), [cells], _place)


def _place(row: Row) -> tuple[int, int, int, int]:
    driver = PLACES.index((row["variant"], row["driver"]))
    vehicles = VEHICLES.index(int(row["vehicles"]))
    return SINGLE_PRESETS.index(row["traffic"]), vehicles, int(row["seed"]), driver


def label(row: Row) -> str:
    """Return the name of a row's driver, with the setting of its variant."""
    setting = VARIANTS[row["variant"]].setting
    return f"{row['driver']}, {setting}" if setting else row["driver"]


def speeds(rows: Iterable[Row]) -> dict[str, Speeds]:
    """Return the mean speeds by label and by traffic, m/s."""
    return {name: values_by_traffic(own) for name, own in grouped(rows, label).items()}


def gain(ours: Speeds, theirs: Speeds) -> Mean:
    """Return the mean of ours minus theirs with its 95 % interval, paired by traffic, m/s.

    Only traffic that both drove counts. Raises DrlAvError if there is none.
    """
    both = [traffic for traffic in ours if traffic in theirs]
    ours, theirs = ({traffic: own[traffic] for traffic in both} for own in (ours, theirs))
    return mean_difference(ours, theirs, "The drivers")


def best_opponent(found: dict[str, Speeds]) -> str:
    """Return the label of the opponent with the highest mean speed in a result of ``speeds``."""
    theirs = {name: fmean(own.values()) for name, own in found.items() if not _is_ours(name)}
    return max(theirs, key=lambda name: theirs[name])


def _is_ours(name: str) -> bool:
    return name.split(",")[0] in OURS


def _cells(rows: Iterable[Row]) -> dict[int, dict[str, Speeds]]:
    """Return ``speeds`` by number of vehicles, in ascending order."""
    return {vehicles: speeds(own) for vehicles, own in rows_by_density(rows).items()}


def _by_kind(results: ResultsFolder) -> dict[str, list[Row]]:
    return grouped(results.rows(OPPONENTS_SWEEP.table), itemgetter("traffic"))


def pooled_table(results: ResultsFolder) -> str:
    """Return the Markdown table of our drivers' gains over the best opponent, m/s, by traffic.

    The episodes with ``MIDDLE`` vehicles are pooled.
    """
    kinds = {kind: _pooled(rows) for kind, rows in _by_kind(results).items()}
    best = {kind: best_opponent(found) for kind, found in kinds.items()}
    lines = [["the best opponent", *(f"`{name}`" for name in best.values())]]
    for name in filter(_is_ours, next(iter(kinds.values()))):
        gains = (gain(found[name], found[best[kind]]) for kind, found in kinds.items())
        lines.append([f"`{name}`", *map(str, gains)])
    return markdown_table(["driver", *kinds], lines)


def hits_table(results: ResultsFolder) -> str:
    """Return the Markdown table of the collisions of each driver, by traffic."""
    kinds = {kind: grouped(rows, label) for kind, rows in _by_kind(results).items()}
    lines = [
        [f"`{name}`", *(collisions_cell(found[name]) for found in kinds.values())]
        for name in next(iter(kinds.values()))
    ]
    return markdown_table(["driver", *kinds], lines)


def gain_over_best_table(results: ResultsFolder) -> str:
    """Return the Markdown table of our drivers' gains over the best opponent, m/s.

    The best opponent is that of the same kind of traffic and number of vehicles. The last column
    pools the episodes with ``MIDDLE`` vehicles, and has a best opponent of its own.
    """
    lines = []
    for kind, rows in _by_kind(results).items():
        cells = [*_cells(rows).values(), _pooled(rows)]
        best = [best_opponent(found) for found in cells]
        lines.append([kind, "the best opponent", *(f"`{name}`" for name in best)])
        for name in filter(_is_ours, cells[0]):
            pairs = zip(cells, best, strict=True)
            gains = (gain(found[name], found[opponent]) for found, opponent in pairs)
            lines.append([kind, f"`{name}`", *map(str, gains)])
    return markdown_table(["traffic", "driver", *map(str, VEHICLES), POOLED], lines)


def same_check_table(results: ResultsFolder) -> str:
    """Return the Markdown table of our drivers' gains over ``STRICT_RULE``, all under ``strict``.

    The gains are in m/s; the last column pools the episodes with ``MIDDLE`` vehicles.
    """
    lines = []
    for kind, rows in _by_kind(results).items():
        cells = [*_cells(rows).values(), _pooled(rows)]
        for name in filter(_is_ours, cells[0]):
            if name.endswith(", strict"):
                gains = (gain(found[name], found[STRICT_RULE]) for found in cells)
                lines.append([kind, f"`{name}`", *map(str, gains)])
    return markdown_table(["traffic", "driver", *map(str, VEHICLES), POOLED], lines)


def _pooled(rows: Iterable[Row]) -> dict[str, Speeds]:
    """Return ``speeds`` of the episodes with ``MIDDLE`` vehicles."""
    return speeds(row for row in rows if int(row["vehicles"]) in MIDDLE)


def aggregate_table(results: ResultsFolder) -> str:
    """Return the Markdown table of each driver's statistics over ``MIDDLE`` vehicles.

    The statistics are the interquartile mean of the speeds, and the probability of being faster
    than the best opponent in these episodes; both with 95 % intervals.
    """
    lines = []
    for kind, rows in _by_kind(results).items():
        best = best_opponent(_pooled(rows))
        cells = [found for number, found in _cells(rows).items() if number in MIDDLE]
        strata = {name: [np.array([*found[name].values()]) for found in cells] for name in cells[0]}
        for name, own in strata.items():
            improvement = "" if name == best else str(probability_of_improvement(own, strata[best]))
            lines.append([kind, f"`{name}`", str(interquartile_mean(own)), improvement])
    return markdown_table(["traffic", "driver", "speed, m/s", "probability of improvement"], lines)


def speed_table(results: ResultsFolder) -> str:
    """Return the Markdown table of mean speeds, m/s, aborted lane changes and collisions."""
    rows, lines = results.rows(OPPONENTS_SWEEP.table), []
    for (kind, name), own in grouped(rows, lambda row: (row["traffic"], label(row))).items():
        cells = rows_by_density(own).values()
        means = [f"{mean_of(episodes, 'mean_speed_m_s'):.2f}" for episodes in cells]
        aborts, changes = (
            sum(int(row[column]) for row in own)
            for column in ("aborted_lane_changes", "lane_changes")
        )
        share = f"{100 * aborts / max(aborts + changes, 1):.0f}"
        lines.append([kind, f"`{name}`", *means, share, collisions_cell(own)])
    last = ["lane changes aborted, %", "ego hit something / was hit"]
    return markdown_table(["traffic", "driver", *map(str, VEHICLES), *last], lines)


def opponents_figure(rows: list[Row]) -> "Figure":
    """Draw each driver's gain over ``REFERENCE`` against the number of vehicles, by traffic.

    A driver has one colour; its curve under ``strict`` is dashed.
    """
    kinds = grouped(rows, itemgetter("traffic"))
    figure, axes = panels((7, 4.2 * len(kinds)), len(kinds), squeeze=False)
    for (kind, own), (panel,) in zip(kinds.items(), axes, strict=True):
        label_axes(panel, "vehicles on the loop", f"gain over {REFERENCE}, m/s")
        panel.set_title(kind)
        cells, curves, colors = _cells(own), {}, dict[str, str]()
        for name in next(iter(cells.values())):
            gains = [gain(found[name], found[REFERENCE]) for found in cells.values()]
            width = 2.5 if _is_ours(name) else 1.0
            style = "--" if name.endswith("strict") else "-"
            color = colors.setdefault(name.split(",")[0], f"C{len(colors)}")
            values = [each.value for each in gains]
            [curves[name]] = panel.plot([*cells], values, style, color=color, linewidth=width)
        panel.set_xlim(0, 1.7 * max(cells))  # room for the legend
        legend_of_names(panel, curves)
    return figure


OPPONENTS_SWEEP = Experiment(
    name="opponents",
    meaning="the shipped driver and the planner beside the strongest rule-based drivers",
    row="an episode of a driver in a kind of traffic, with a check and a longitudinal reference",
    plan=opponents_plan,
    summaries={
        "opponents": pooled_table,
        "opponents_hits": hits_table,
        "opponents_gain": gain_over_best_table,
        "opponents_same_check": same_check_table,
        "opponents_aggregate": aggregate_table,
        "opponents_speed": speed_table,
    },
    figures={"opponents": opponents_figure},
)
