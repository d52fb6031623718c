"""Makes the panels of figures and writes PNG files; the only module that imports matplotlib."""

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_av.files.atomic import make_folder, write_atomic

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


def legend_of_names(axes: "Axes | Figure", curves: Mapping[str, Any], **options: Any) -> None:
    """Add a legend that shows the names (keys) of the curves literally; long names are shortened.

    By itself matplotlib would read ``$`` as a formula, and omit names that begin with ``_``.
    ``options`` are further arguments of matplotlib's ``legend``.
    """
    names = ["name"] * len(curves)
    legend = axes.legend(list(curves.values()), names, frameon=False, **options)
    for text, name in zip(legend.get_texts(), curves, strict=True):
        shown = name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 3]}..."
        text.set(text=shown, parse_math=False)


FORMATS: dict[str, dict[str, None]] = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None},
    ".svg": {"Date": None},
}
"""The metadata of a figure by its file's suffix: none that would change from run to run."""


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure atomically, as PNG, PDF or SVG by the suffix of ``path``.

    Raises DrlAvError if the write fails.
    """
    from matplotlib import rc_context

    make_folder(path.parent, "--out")
    data, suffix = io.BytesIO(), path.suffix.lower()
    with rc_context({"svg.hashsalt": "drl-av", "svg.fonttype": "none"}):
        figure.savefig(data, format=suffix[1:], dpi=150, metadata=FORMATS[suffix])
    write_atomic(path, data.getvalue())


def save_pages(figures: "Iterable[Figure]", path: Path) -> None:
    """Write figures as the pages of one PDF file; raises DrlAvError if the write fails."""
    from matplotlib.backends.backend_pdf import PdfPages

    make_folder(path.parent, "--out")
    data = io.BytesIO()
    with PdfPages(data, metadata=FORMATS[".pdf"]) as pages:
        for figure in figures:
            pages.savefig(figure)
    write_atomic(path, data.getvalue())


COLUMNS_IN = {1: 3.5, 2: 7.16}
"""Width of one and of two columns of a paper, inches (IEEE)."""


def fit_columns(figure: "Figure", columns: int) -> None:
    """Give a figure the width of one or two columns of a paper, and all its text 8 points."""
    from matplotlib.text import Text

    width, height = figure.get_size_inches()
    scale = COLUMNS_IN[columns] / width
    figure.set_size_inches(COLUMNS_IN[columns], max(scale * height, 0.75 * COLUMNS_IN[1]))
    for text in figure.findobj(Text):
        text.set_fontsize(8)


def add_title(figure: "Figure", title: str) -> None:
    """Write a title above a figure, literally."""
    figure.suptitle(title, fontsize="medium", wrap=True).set_parse_math(False)
