"""Prints the tables of ``drl-av evaluate``."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.measure import Measurement
from rich.table import Table

from drl_av.cli.console import make_console, plus_minus

if TYPE_CHECKING:
    from drl_av.evaluation.criticality import Style
    from drl_av.evaluation.statistics import Mean, Overall, PairedGain, Summary

Columns = Mapping[str, Sequence[object]]
"""The cells of each column of a table by its heading."""
WIDEST = 1000
"""Characters, more than any table has."""
NAMES = ("driver", "fastest baseline")
"""Columns whose cells are names: these may fold, numbers may not."""


def _table(columns: Columns, sections: Sequence[object]) -> Table:
    """Return a table; a line separates rows with different ``sections``, which may be empty."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    for heading in columns:
        if heading in NAMES:
            table.add_column(heading, overflow="fold")
        else:
            table.add_column(heading, justify="right", no_wrap=True)
    for place, row in enumerate(zip(*columns.values(), strict=True)):
        if sections and place and sections[place] != sections[place - 1]:
            table.add_section()
        table.add_row(*map(str, row))
    return table


def _show(
    title: str, keys: Columns, values: Columns, caption: str, sections: Sequence[object] = ()
) -> None:
    """Print a table between a title and a caption, which may be wider than the table.

    A table that is wider than the output becomes two: each has the keys and half of the values.
    """
    console = make_console()
    tables = [_table({**keys, **values}, sections)]
    unlimited = console.options.update(max_width=WIDEST)
    if Measurement.get(console, unlimited, tables[0]).maximum > console.width:
        cells, middle = list(values.items()), (len(values) + 1) // 2
        halves = cells[:middle], cells[middle:]
        tables = [_table({**keys, **dict(half)}, sections) for half in halves if half]
    console.print(title)
    for place, table in enumerate(tables):
        console.print(*[""] * place, table, sep="\n")
    console.print(f"{caption}\n")


def print_summaries(summaries: Sequence["Summary"]) -> None:
    """Print a table with one row for each driver and number of vehicles."""
    ways = {
        heading: [getattr(summary, name) for summary in summaries]
        for heading, name in (("exit\ntaken", "exits_taken"), ("merged", "merged"))
        if any(getattr(summary, name) is not None for summary in summaries)
    }
    vehicles = [summary.vehicles for summary in summaries]
    _show(
        title_of((summary.driver, summary.safety_check) for summary in summaries),
        {"vehi-\ncles": vehicles, "driver": [summary.driver for summary in summaries]},
        {
            "speed\nm/s": [_cell(summary.speed_m_s) for summary in summaries],
            "reward": [_cell(summary.reward, 3) for summary in summaries],
            "ego\nhit": [summary.ego_hits for summary in summaries],
            "was\nhit": [summary.collisions - summary.ego_hits for summary in summaries],
            "safety\ntriggers": [_cell(summary.triggers, 1) for summary in summaries],
            "lane\nchanges": [_cell(summary.lane_changes, 1) for summary in summaries],
            **ways,
        },
        _caption(summaries),
        vehicles,
    )


def _caption(summaries: Sequence["Summary"]) -> str:
    fewest, most = (pick(summary.episodes for summary in summaries) for pick in (min, max))
    number = str(most) if fewest == most else f"{fewest} to {most}"
    noun = "episode" if number == "1" else "episodes"
    return f"{number} {noun} each, ± half of the 95 % interval{_of_trainings(summaries)}"


def _of_trainings(found: Iterable["Summary | Overall"]) -> str:
    """Return what a caption says about groups of trainings; "" without a group."""
    trainings = {each.driver: each.trainings for each in found if each.trainings}
    groups = ", ".join(f"{number} of {driver}" for driver, number in trainings.items())
    return f", over trainings: {groups}" if groups else ""


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
    keys: Columns = {
        "vehicles": [gain.vehicles for gain in gains],
        "driver": [gain.driver for gain in gains],
        "fastest baseline": [gain.baseline for gain in gains],
    }
    values = {"gain in\nspeed, m/s": [_cell(gain.difference_m_s) for gain in gains]}
    _show(title, keys, values, "paired by seed, ± half of the 95 % interval")


def print_overall(overalls: Sequence["Overall"], title: str) -> None:
    """Print a table with the statistics of each driver over all numbers of vehicles."""
    best = next((each.over for each in overalls if each.over), None)
    values: dict[str, list[Any]] = {"speed, m/s": [each.speed_m_s for each in overalls]}
    if best is not None:
        values["probability of\nimprovement"] = [each.improvement or "" for each in overalls]
    beside = "" if best is None else f", and the probability of being faster than {best}"
    unit = "trainings" if (trainings := _of_trainings(overalls)) else "traffic seeds"
    caption = (
        f"over all numbers of vehicles: interquartile mean{beside}, with 95 % intervals by the "
        f"bootstrap of {unit}{trainings.removeprefix(', over trainings')}"
    )
    _show(title, {"driver": [each.driver for each in overalls]}, values, caption)


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
    values = {
        heading: [f"{getattr(style, name):.2f}" for style in styles]
        for heading, name in headings.items()
    }
    caption = (
        "over all episodes; comfort: decisions within nuPlan's bounds;\n"
        "TET: TTC of at most 3 s to the vehicle ahead"
    )
    _show(title, {"driver": [style.driver for style in styles]}, values, caption)


def _cell(mean: "Mean", digits: int = 2) -> str:
    return f"{mean:.{digits}f}".replace(" ± ", plus_minus())
