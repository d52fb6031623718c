"""Makes the panels of figures and writes PNG files; the only module that imports matplotlib."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_av.files import make_folder, write_atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LONGEST_NAME = 80
"""Largest number of characters of a name in a legend."""


def panels(size: tuple[float, float], *shape: int, **options: Any) -> "tuple[Figure, Any]":
    """Make a figure of ``size`` (width, height) inches with panels; return it and its axes.

    The axes are an array of ``shape``, or a single Axes without ``shape``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(*shape, **options)


def one_panel(x: str, y: str) -> "tuple[Figure, Axes]":
    """Make a figure with one panel, whose axes have the labels ``x`` and ``y``."""
    figure, axes = panels((7, 4.2))
    label_axes(axes, x, y)
    return figure, axes


def label_axes(axes: "Axes", x: str = "", y: str = "") -> None:
    """Label the axes of a panel, add a faint grid, and hide its upper and right frame lines."""
    axes.set(**{name: label for name, label in (("xlabel", x), ("ylabel", y)) if label})
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def legend_of_names(axes: "Axes", curves: Mapping[str, Any]) -> None:
    """Add a legend that shows the names (keys) of the curves literally; long names are shortened.

    By itself matplotlib would read ``$`` as a formula, and omit names that begin with ``_``.
    """
    legend = axes.legend(list(curves.values()), ["name"] * len(curves), frameon=False)
    for text, name in zip(legend.get_texts(), curves, strict=True):
        shown = name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 3]}..."
        text.set(text=shown, parse_math=False)


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure as a PNG file atomically; raises DrlAvError if the write fails."""
    make_folder(path.parent, "--out")
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=150, metadata={"Software": None})
    write_atomic(path, data.getvalue())
