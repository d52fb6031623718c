"""Prints the tables of ``drl-av evaluate``."""

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import JustifyMethod
from rich.table import Table

from drl_av.cli.console import make_console, plus_minus

if TYPE_CHECKING:
    from drl_av.evaluation.criticality import Style
    from drl_av.evaluation.statistics import Mean, Overall, PairedGain, Summary


def _table(*headings: str) -> Table:
    """Return a table; a column with the name of a driver may fold, one of numbers may not."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    for heading in headings:
        if heading in ("driver", "fastest baseline"):
            table.add_column(heading, overflow="fold")
        else:
            justify: JustifyMethod = "left" if heading == "check" else "right"
            table.add_column(heading, justify=justify, no_wrap=True)
    return table


def print_summaries(summaries: Sequence["Summary"]) -> None:
    """Print a table with one row for each driver and number of vehicles."""
    several_checks = len({summary.safety_check for summary in summaries}) > 1
    ways = {
        heading: name
        for heading, name in (("exit\ntaken", "exits_taken"), ("merged", "merged"))
        if any(getattr(summary, name) is not None for summary in summaries)
    }
    table = _table(
        *("vehi-\ncles", "driver", *(["check"] if several_checks else [])),
        *("speed\nm/s", "reward", "ego\nhit", "was\nhit", "safety\ntriggers", "lane\nchanges"),
        *ways,
    )
    former = None
    for summary in summaries:
        if former not in (None, summary.vehicles):
            table.add_section()
        former = summary.vehicles
        table.add_row(
            str(summary.vehicles),
            summary.driver,
            *([summary.safety_check] if several_checks else []),
            _cell(summary.speed_m_s),
            _cell(summary.reward, 3),
            str(summary.ego_hits),
            str(summary.collisions - summary.ego_hits),
            _cell(summary.triggers, 1),
            _cell(summary.lane_changes, 1),
            *(str(getattr(summary, name)) for name in ways.values()),
        )
    title = title_of((summary.driver, summary.safety_check) for summary in summaries)
    _show(table, title, _caption(summaries))


def _caption(summaries: Sequence["Summary"]) -> str:
    fewest, most = (pick(summary.episodes for summary in summaries) for pick in (min, max))
    number = str(most) if fewest == most else f"{fewest} to {most}"
    noun = "episode" if number == "1" else "episodes"
    return f"{number} {noun} each, ± half of the 95 % interval"


def _show(table: Table, title: str, caption: str) -> None:
    """Print a table between a title and a caption, which may be wider than the table."""
    console = make_console()
    console.print(title)
    console.print(table)
    console.print(f"{caption}\n")


def title_of(checks: Iterable[tuple[str, str]]) -> str:
    """Return the title of tables and figures: the check under which each driver drives.

    ``checks`` holds each driver with its check; a pair may occur several times.
    """
    drivers: dict[str, list[str]] = {}
    for driver, check in dict.fromkeys(checks):
        drivers.setdefault(check, []).append(driver)
    if len(drivers) == 1:
        return f"safety check: {next(iter(drivers))}"
    return "safety checks: " + "; ".join(f"{c}: {', '.join(names)}" for c, names in drivers.items())


def print_gains(gains: Sequence["PairedGain"], title: str) -> None:
    """Print each driver's gain in mean speed, m/s, over the fastest rule-based driver.

    The table has one row for each driver and number of vehicles.
    """
    headings = ("vehicles", "driver", "fastest baseline", "gain in\nspeed, m/s")
    table = _table(*headings)
    for gain in gains:
        cells = (gain.driver, gain.baseline, _cell(gain.difference_m_s))
        table.add_row(str(gain.vehicles), *cells)
    _show(table, title, "paired by seed, ± half of the 95 % interval")


def print_overall(overalls: Sequence["Overall"], title: str) -> None:
    """Print a table with the statistics of each driver over all numbers of vehicles."""
    best = next((each.over for each in overalls if each.over), None)
    beside = "" if best is None else f", and the probability\nof being faster than {best}"
    table = _table(
        *("driver", "speed, m/s", *([] if best is None else ["probability of\nimprovement"]))
    )
    for each in overalls:
        improvement = "" if each.improvement is None else str(each.improvement)
        table.add_row(each.driver, str(each.speed_m_s), *([] if best is None else [improvement]))
    caption = (
        f"over all numbers of vehicles: interquartile mean{beside}, "
        "with 95 % intervals by the stratified bootstrap"
    )
    _show(table, title, caption)


def print_styles(styles: Sequence["Style"], title: str) -> None:
    """Print a table of the comfort and the criticality of each driver."""
    headings = {
        "reversals\n/km": "reversals_per_km",
        "jerk\nm/s³": "mean_abs_jerk_m_s3",
        "comfort\n%": "comfortable_percent",
        "TET\ns/km": "tet_s_per_km",
        "DRAC\nm/s²": "max_drac_m_s2",
        "PET\ns": "min_pet_s",
        "gap < 1 s\n%": "short_headways_percent",
        "forced\n/1000": "forced_brakes_per_1000",
    }
    table = _table("driver", *headings)
    for style in styles:
        table.add_row(style.driver, *(f"{getattr(style, name):.2f}" for name in headings.values()))
    caption = (
        "over all episodes; comfort: decisions within nuPlan's bounds;\n"
        "TET: TTC of at most 3 s to the vehicle ahead"
    )
    _show(table, title, caption)


def _cell(mean: "Mean", digits: int = 2) -> str:
    if math.isinf(mean.half_width):
        return f"{mean.value:.{digits}f}"
    return f"{mean.value:.{digits}f}{plus_minus()}{mean.half_width:.{digits}f}"
