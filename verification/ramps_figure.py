"""Draws the results that ``verification.ramps`` printed, against the flow.

    python -m verification.ramps_figure docs/results

The program reads ``merge.txt``, ``exit.txt`` and ``ramp_to_ramp.txt`` in this folder, and, if they
exist, ``merge_learned.txt`` and so on. It writes ``ramps.png`` into the folder. Error bars are 95 %
intervals.
"""

import re
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from drl_av.errors import DrlAvError
from drl_av.evaluation.figure_style import label_axes, legend_of_names, panels, save_figure
from verification.program import Program, run_program
from verification.ramps import PRINTED, SUCCESS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.container import ErrorbarContainer

COLOURS = {"gap-mobil": "#999999", "sumo": "#009e73"}
LEARNED = "#d55e00"
TITLES = {"merge": "On-ramp", "exit": "Off-ramp", "ramp_to_ramp": "Ramp to ramp"}
MEASURES = {
    "success": "success, %",
    "behind": "episodes with braking behind, %",
    "lost": "time lost, s",
}
_NUMBER = re.compile(r"-?\d+\.\d+")


class Point(NamedTuple):
    """One measure of one driver at one flow, with its interval."""

    flow_per_h: float
    value: float
    low: float
    high: float


def points(text: str, measure: str) -> dict[str, list[Point]]:
    """Return the points of each driver in the text that ``verification.ramps`` printed.

    ``measure`` is a key of ``MEASURES``. The time lost has no interval: ``low`` and ``high`` are
    the value. An unknown time lost has no point.
    """
    found: dict[str, list[Point]] = defaultdict(list)
    for each in PRINTED.finditer(text):
        numbers = [float(number) for number in _NUMBER.findall(each[measure])]
        if numbers:
            value, low, high = numbers * 3 if len(numbers) == 1 else numbers
            found[each["driver"]].append(Point(float(each["flow"]), value, low, high))
    return dict(found)


def draw(axes: "Axes", text: str, measure: str) -> "dict[str, ErrorbarContainer]":
    """Draw one measure of each driver against the flow, and return each driver's curve."""
    curves = {}
    for driver, line in points(text, measure).items():
        flows, values, low, high = np.array(line).T
        style: dict[str, Any] = {"color": COLOURS.get(driver, LEARNED), "marker": "o", "ms": 4}
        errors = values - low, high - values
        curves[driver] = axes.errorbar(flows, values, errors, capsize=2, lw=1.2, **style)
    return curves


def main() -> None:
    """Read the printed lines and write the figure."""
    parser = Program(__doc__)
    parser.add_argument("folder", type=Path, help="folder of the printed files and the figure")
    folder = parser.parse_args().folder
    figure, grid = panels((11, 8.5), len(MEASURES), len(SUCCESS), sharex=True, sharey="row")
    for column, kind in enumerate(SUCCESS):
        files = (folder / f"{kind}.txt", folder / f"{kind}_learned.txt")
        text = "".join(file.read_text(encoding="utf-8") for file in files if file.is_file())
        if not text:
            raise DrlAvError(f"{folder} has no {files[0].name}: make it with verification.ramps.")
        grid[0, column].set_title(TITLES[kind])
        for row, (measure, name) in enumerate(MEASURES.items()):
            axes = grid[row, column]
            label_axes(axes, "vehicles/h/lane" if row == 2 else "", "" if column else name)
            curves = draw(axes, text, measure)
            if row == 0:
                legend_of_names(axes, curves)
    save_figure(figure, folder / "ramps.png")


if __name__ == "__main__":
    run_program(main)
