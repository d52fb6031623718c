"""Prints the tables of ``drl-av evaluate``."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import JustifyMethod
from rich.table import Table

from drl_av.cli.console import make_console, plus_minus

if TYPE_CHECKING:
    from drl_av.evaluation.criticality import Style
    from drl_av.evaluation.paired import PairedGain
    from drl_av.evaluation.statistics import Mean, Overall, Summary


def _table(title: str, caption: str, *headings: str) -> Table:
    """Return a table; a column with the name of a driver may fold, one of numbers may not."""
    table = Table(
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        title=title,
        title_justify="left",
        caption=caption,
        caption_justify="left",
    )
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
        title_of(summaries),
        _caption(summaries),
        *("vehicles", "driver", *(["check"] if several_checks else [])),
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
            _cell(summary.triggers),
            _cell(summary.lane_changes),
            *(str(getattr(summary, name)) for name in ways.values()),
        )
    make_console().print(table)


def _caption(summaries: Sequence["Summary"]) -> str:
    fewest, most = (pick(summary.episodes for summary in summaries) for pick in (min, max))
    number = str(most) if fewest == most else f"{fewest} to {most}"
    noun = "episode" if number == "1" else "episodes"
    return f"{number} {noun} each, ± half of the 95 % interval"


def title_of(summaries: Sequence["Summary"]) -> str:
    """Return the title of the tables of an evaluation: the check under which each driver drives."""
    drivers: dict[str, list[str]] = {}
    for summary in summaries:
        names = drivers.setdefault(summary.safety_check, [])
        names += [] if summary.driver in names else [summary.driver]
    if len(drivers) == 1:
        return f"safety check: {summaries[0].safety_check}"
    return "safety checks: " + "; ".join(f"{c}: {', '.join(names)}" for c, names in drivers.items())


def print_gains(gains: Sequence["PairedGain"], title: str) -> None:
    """Print each driver's gain in mean speed, m/s, over the fastest rule-based driver.

    The table has one row for each driver and number of vehicles.
    """
    headings = ("vehicles", "driver", "fastest baseline", "gain in\nspeed, m/s")
    table = _table(title, "paired by seed, ± half of the 95 % interval", *headings)
    for gain in gains:
        cells = (gain.driver, gain.baseline, _cell(gain.difference_m_s))
        table.add_row(str(gain.vehicles), *cells)
    make_console().print(table)


def print_overall(overalls: Sequence["Overall"], title: str) -> None:
    """Print a table with the statistics of each driver over all numbers of vehicles."""
    best = next((each.over for each in overalls if each.over), None)
    beside = "" if best is None else f", and the probability of being faster than {best}"
    table = _table(
        title,
        f"over all numbers of vehicles: interquartile mean{beside},\n"
        "with 95 % intervals by the stratified bootstrap",
        *("driver", "speed, m/s", *([] if best is None else ["probability of\nimprovement"])),
    )
    for each in overalls:
        improvement = "" if each.improvement is None else str(each.improvement)
        table.add_row(each.driver, str(each.speed_m_s), *([] if best is None else [improvement]))
    make_console().print(table)


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
    table = _table(
        title,
        "over all episodes; comfort: decisions within nuPlan's bounds;\n"
        "TET: TTC of at most 3 s to the vehicle ahead",
        *("driver", *headings),
    )
    for style in styles:
        table.add_row(style.driver, *(f"{getattr(style, name):.2f}" for name in headings.values()))
    make_console().print(table)


def _cell(mean: "Mean", digits: int = 2) -> str:
    if math.isinf(mean.half_width):
        return f"{mean.value:.{digits}f}"
    return f"{mean.value:.{digits}f}{plus_minus()}{mean.half_width:.{digits}f}"
