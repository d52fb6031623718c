"""Draws the figures of studies: values with their 95 % intervals, as curves in panels."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_av.evaluation.figure_style import label_axes, legend_of_names, panels
from drl_av.evaluation.figures import APART, curves_by_density
from drl_av.evaluation.statistics import Mean
from studies.pivot import Pivot, Spec, values_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from studies.study import FileStudy

Curves = dict[str, list[tuple[Any, Mean]]]
"""The points of each curve by its name: x and the mean."""


def figure(study: "FileStudy", spec: Spec | Sequence[Spec], folder: Path) -> "Figure":
    """Draw a specification [figures.NAME], or one panel for each of several.

    A specification with "panels" has one panel for each value of that column. Several panels share
    one legend.

    Raises DrlAvError if a table is damaged.
    """
    found: list[tuple[str, Spec, Curves]] = []
    for each in [spec] if isinstance(spec, Mapping) else spec:
        pivot = Pivot(study, each, folder)
        column = each.get("panels")
        for value in values_of(pivot.shown, column) if column else [None]:
            where = {} if column is None else {column: value}
            found.append((each.get("title", value or ""), each, curves(pivot, where)))
    wide = min(len(found), 2)
    high = math.ceil(len(found) / wide)
    size = (7.0, 4.2) if wide == 1 else (11.5, 0.6 + 3.6 * high)
    drawn, axes = panels(size, high, wide, squeeze=False)
    handles: dict[str, Any] = {}
    for (title, each, own), panel in zip(found, axes.flat, strict=False):
        handles |= _draw(panel, title, each, own)
    for panel in axes.flat[len(found) :]:
        panel.set_axis_off()
        legend_of_names(panel, handles, loc="center")
    if wide == 1:
        legend_of_names(axes[0, 0], handles)
    elif len(found) == axes.size and len(handles) > 1:
        legend_of_names(drawn, handles, loc="outside lower center", ncols=4)
    return drawn


def curves(pivot: Pivot, where: Mapping[str, Any]) -> Curves:
    """Return the points of each curve of a figure, for the rows with the values ``where``.

    If x is a measure, a curve has one point for each value of the column "along".
    """
    spec = pivot.spec
    x = spec["x"]
    along = spec.get("along", x)
    lines = ["label"] if x != "label" else []
    found: Curves = {}
    for key in pivot.keys([*where, *lines], pivot.shown):
        if where.items() <= key.items():
            name = str(key.get("label", "")).strip("`")
            for place in values_of(pivot.shown, along):
                value = pivot.value(spec["value"], key, {along: place})
                at = place if x == along else pivot.value(x, key, {along: place})
                if isinstance(value, Mean):
                    point = at.value if isinstance(at, Mean) else at, value
                    found.setdefault(name, []).append(point)
    return found


def _draw(panel: "Axes", title: str, spec: Spec, own: Curves) -> dict[str, Any]:
    label_axes(panel, *spec["labels"])
    panel.set_title(title)
    if spec.get("line"):
        panel.axhline(0.0, color="#999999", linewidth=1)
    if spec["x"] == "label":
        points = next(iter(own.values()), [])
        means = [(place, mean) for place, (_, mean) in enumerate(points)]
        curves_by_density(panel, {"": means}, joined=False)
        panel.set_xticks(range(len(points)), [name for name, _ in points], rotation=35, ha="right")
        return {}
    return curves_by_density(panel, own, apart=0.0 if "along" in spec else APART)
