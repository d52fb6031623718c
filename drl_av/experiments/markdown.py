"""The tables of the documentation in Markdown, and the cells that several of them have."""

from collections.abc import Callable, Iterable, Sequence

from drl_av.evaluation.statistics import mean_with_interval
from drl_av.files import Row

PAPER_VEHICLES = 30
"""The most vehicles of the paper's traffic, N_T."""


def markdown_table(heading: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    names = list(heading)
    lines = [names, ["---"] * len(names), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def by_density(rows: Sequence[Row], column: str, cell: Callable[[list[Row]], str]) -> str:
    """A row for each value of a column, and a column for each number of vehicles."""
    densities = densities_of(rows)
    lines = [
        [
            f"`{value}`",
            *(
                cell([r for r in rows if r[column] == value and int(r["vehicles"]) == density])
                for density in densities
            ),
        ]
        for value in dict.fromkeys(row[column] for row in rows)
    ]
    return markdown_table(["vehicles", *map(str, densities)], lines)


def densities_of(rows: Iterable[Row]) -> list[int]:
    """The numbers of vehicles, each once, the smallest first."""
    return sorted({int(row["vehicles"]) for row in rows})


def mean_of(rows: Iterable[Row], column: str) -> float:
    """Mean of a column of numbers."""
    return mean_with_interval(float(row[column]) for row in rows).value


def mean_speed(rows: Iterable[Row]) -> str:
    """Mean of the episodes' mean speeds, m/s, and half of its 95 % interval."""
    return str(mean_with_interval(float(row["mean_speed_m_s"]) for row in rows))


def collisions(rows: Sequence[Row]) -> tuple[int, int]:
    """Episodes in which the ego hit something, and in which it was hit."""
    hits = count(rows, "ego_hit")
    return hits, count(rows, "collided") - hits


def collisions_cell(rows: Sequence[Row]) -> str:
    """The ego hit something / was hit, of so many episodes."""
    hits, was_hit = collisions(rows)
    return f"{hits} / {was_hit} of {len(rows)}"


def count(rows: Iterable[Row], column: str) -> int:
    """Rows in which a column is true."""
    return sum(row[column] == "True" for row in rows)


def closer_than_safe(rows: Iterable[Row]) -> float:
    """Mean share of the decisions after which the vehicle ahead is closer than d_safe, percent."""
    return mean_with_interval(
        100 * int(row["d_safe_violations"]) / int(row["decisions"]) for row in rows
    ).value
