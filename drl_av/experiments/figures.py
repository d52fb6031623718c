"""The figures of a folder of results, each from its own table."""

from collections.abc import Callable, Generator, Iterator
from pathlib import Path

from matplotlib.figure import Figure

from drl_av.config import Config
from drl_av.errors import DrlAvError
from drl_av.experiments.adaptation_figure import adaptation_figure
from drl_av.experiments.barricade_figure import barricade_figure
from drl_av.experiments.curves_figure import check_figure, replay_figure
from drl_av.experiments.drawing import reward_figure, save_figure, speed_figure
from drl_av.experiments.lane_change_figure import lane_change_figure
from drl_av.experiments.options import Progress, Scale
from drl_av.experiments.strictness_figure import strictness_figure
from drl_av.experiments.tables import intact

FIGURES: dict[str, tuple[str, Callable[[Path], Figure]]] = {
    "mean_speed": ("evaluation.csv", lambda table: speed_figure([table])),
    "learning_check": ("curves.csv", check_figure),
    "learning_replay": ("curves.csv", replay_figure),
    "adaptation": ("adaptation.csv", adaptation_figure),
    "barricade": ("barricade.csv", barricade_figure),
    "strict": ("strict.csv", strictness_figure),
}
"""The table of each, and how it is drawn."""
WITHOUT_TABLE: dict[str, Callable[[Config], Figure]] = {
    "reward": reward_figure,
    "lane_change": lane_change_figure,
}
"""Those that the settings alone determine."""


def published(folder: Path) -> Iterator[tuple[str, Figure]]:
    """Every figure whose table is in the folder, and its name.

    Raises:
        DrlAvError: a table is damaged, or there is none.
    """
    drawn = {name: of for name, of in FIGURES.items() if (folder / of[0]).is_file()}
    if not drawn:
        raise DrlAvError(
            f"{folder} holds neither a run nor results: make them with drl-av reproduce."
        )
    for name, (table, draw) in drawn.items():
        with intact(folder / table):
            figure = draw(folder / table)
        yield name, figure


def figures(scale: Scale) -> Generator[Progress, None, None]:
    """Draw what the results allow, into the same folder."""
    config = scale.over(Config())
    drawings = [(name, draw(config)) for name, draw in WITHOUT_TABLE.items()]
    if any((scale.out / table).is_file() for table, _ in FIGURES.values()):
        drawings += published(scale.out)
    for done, (name, figure) in enumerate(drawings, start=1):
        path = scale.out / f"{name}.png"
        save_figure(figure, path)
        yield Progress(done, len(drawings), line=str(path))
