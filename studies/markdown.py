"""Makes the Markdown tables of the documentation, and the statistics that several tables share."""

from collections.abc import Callable, Iterable, Sequence
from operator import itemgetter

from drl_av.evaluation.statistics import grouped, mean_with_interval
from drl_av.files import Row

PAPER_VEHICLES = 30
"""N_T of the paper: the largest number of vehicles in the paper's traffic."""


def markdown_table(heading: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown with a heading row."""
    names = list(heading)
    lines = [names, ["---"] * len(names), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def by_density(rows: Sequence[Row], column: str, cell: Callable[[list[Row]], str]) -> str:
    """Return a Markdown table: a row for each value of ``column``, a column for each density.

    ``cell`` computes the text of a cell from the rows with its value and its number of vehicles.
    Without such rows the cell is empty.
    """
    densities = densities_of(rows)
    lines = []
    for value, own in grouped(rows, itemgetter(column)).items():
        found = rows_by_density(own)
        cells = (cell(found[number]) if number in found else "" for number in densities)
        lines.append([f"`{value}`", *cells])
    return markdown_table(["vehicles", *map(str, densities)], lines)


def columns_by_density(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the rows by the heading of their table column: each density, then "up to 30".

    The last column is over all densities up to ``PAPER_VEHICLES``.
    """
    columns = {str(number): own for number, own in rows_by_density(rows).items()}
    return columns | {f"up to {PAPER_VEHICLES}": up_to_30(rows)}


def up_to_30(rows: Iterable[Row]) -> list[Row]:
    """Return the rows with at most ``PAPER_VEHICLES`` vehicles."""
    return [row for row in rows if int(row["vehicles"]) <= PAPER_VEHICLES]


def rows_by_density(rows: Iterable[Row]) -> dict[int, list[Row]]:
    """Return the rows by their number of vehicles, in ascending order."""
    return dict(sorted(grouped(rows, lambda row: int(row["vehicles"])).items()))


def densities_of(rows: Iterable[Row]) -> list[int]:
    """Return the numbers of vehicles in the rows, each once, in ascending order."""
    return sorted({int(row["vehicles"]) for row in rows})


def mean_of(rows: Iterable[Row], column: str) -> float:
    """Return the mean of a column of numbers."""
    return mean_with_interval(float(row[column]) for row in rows).value


def values_by_traffic(
    rows: Iterable[Row], column: str = "mean_speed_m_s"
) -> dict[tuple[str, str], float]:
    """Return the value of a column in each traffic; the keys are the number of vehicles and seed.

    The values of two drivers are compared by ``evaluation.statistics.mean_difference``.
    """
    return {(row["vehicles"], row["seed"]): float(row[column]) for row in rows}


def mean_speed(rows: Iterable[Row]) -> str:
    """Return the mean of the episodes' mean speeds and its 95 % interval, m/s: "25.28 ± 0.30"."""
    return str(mean_with_interval(float(row["mean_speed_m_s"]) for row in rows))


def collisions(rows: Sequence[Row]) -> tuple[int, int]:
    """Count the episodes in which the ego hit something, and those in which a vehicle hit it."""
    hits = count(rows, "ego_hit")
    return hits, count(rows, "collided") - hits


def collisions_cell(rows: Sequence[Row]) -> str:
    """Return the two numbers of ``collisions`` and the number of episodes, as "1 / 0 of 100"."""
    hits, was_hit = collisions(rows)
    return f"{hits} / {was_hit} of {len(rows)}"


def count(rows: Iterable[Row], column: str) -> int:
    """Count the rows in which a column is "True"."""
    return sum(row[column] == "True" for row in rows)


def closer_than_safe(rows: Iterable[Row]) -> float:
    """Return the mean share, %, of decisions after which the gap ahead is smaller than d_safe."""
    return mean_with_interval(
        100 * int(row["d_safe_violations"]) / int(row["decisions"]) for row in rows
    ).value
