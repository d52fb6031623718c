"""The options of ``python -m studies``, and what all kinds of studies have in common."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from drl_av.config import Config, from_sections, with_files
from drl_av.drivers.registry import default_config, find_drivers
from drl_av.errors import ConfigError
from drl_av.evaluation import LOKY
from drl_av.evaluation.table import Inputs
from drl_av.files.table import Row
from drl_av.scenarios.folder import with_scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from studies.engine import EpisodeCell
    from studies.trainings import TrainingRows

FOLDER = Path(__file__).parent
RESULTS = FOLDER.parent / "docs" / "results"
QUICK = FOLDER / "quick" / "settings.toml"
"""The settings of a quick form: few and short episodes."""


Settings = Mapping[str, Mapping[str, Any]]
"""Values of settings by section and name."""


def changed(config: Config, settings: Settings) -> Config:
    """Return the config with other values of some settings; ``traffic.kind`` names a kind."""
    return from_sections(settings, config, "a study")


def settings_of(drivers: Sequence[str]) -> Config:
    """Return the settings with which ``drivers`` drive in a study that sets no others.

    They are those of the first learned driver, or the defaults without one, with the check
    ``paper``.
    """
    return default_config(find_drivers(drivers)).updated("safety", check="paper")


class Options(NamedTuple):
    """The size of a study, its number of processes, and the folders of its files."""

    jobs: int = 2
    """Number of processes."""
    engine: str = LOKY
    """A name in ``evaluation.engines.ENGINES``."""
    runs: Path = Path("runs/studies")
    """Folder of the trainings' folders; a training continues from its folder."""
    out: Path = RESULTS
    """Folder of the tables, their provenance and the figures."""
    config: tuple[str, ...] = ()
    """TOML files with settings that replace those of each study, in this order."""
    most_trainings: int | None = None
    """Largest number of seeds of each training; None for those of the study."""
    most_episodes: int | None = None
    """Largest number of evaluation episodes in each cell; None for those of the study."""
    most_vehicles: int | None = None
    """Largest number of different numbers of vehicles; None for those of the study."""

    def with_files(self, config: Config) -> Config:
        """Return the settings of a study, changed by the user's TOML files.

        Raises ConfigError if a file or a setting in it is wrong.
        """
        return with_scenario(with_files(config, self.config))

    def settings(self, config: Config, *own: Settings) -> Config:
        """Return a config with a study's ``own`` settings, changed by the user's TOML files.

        Raises ConfigError if a file is wrong, or replaces a setting that the study itself sets.
        """
        for settings in own:
            config = with_scenario(changed(config, settings))
        if str(QUICK) in self.config:  # which replaces what a study sets
            config = with_files(config, [str(QUICK)])
        made = self.with_files(config)
        for section, values in (named for each in own for named in each.items()):
            before, after = asdict(getattr(config, section)), asdict(getattr(made, section))
            for key in values:
                if self._names_traffic() if key == "kind" else before[key] != after[key]:
                    raise ConfigError(
                        f"{section}.{key} is what the study itself sets: leave it out, or write a "
                        "study of your own (docs/extend/study.md)."
                    )
        return made

    def _names_traffic(self) -> bool:
        """Whether the user's files name a kind of traffic, so that another one below is lost."""
        kinds = (Config().with_traffic(kind) for kind in ("calm", "hazards"))
        return len({with_files(config, self.config).traffic for config in kinds}) == 1

    def trainings(self, seeds: int) -> int:
        """Return the number of seeds of a training of which the study has ``seeds``."""
        return seeds if self.most_trainings is None else min(seeds, self.most_trainings)

    def episodes(self, seeds: int) -> int:
        """Return the number of episodes of a cell of which the study has ``seeds``."""
        return seeds if self.most_episodes is None else min(seeds, self.most_episodes)

    def vehicles(self, numbers: Sequence[int]) -> list[int]:
        """Return the numbers of vehicles of a study that has ``numbers`` of them."""
        if self.most_vehicles is None or len(numbers) <= self.most_vehicles:
            return list(numbers)
        return list(numbers[1 :: len(numbers) // 2][: self.most_vehicles])


class Call(NamedTuple):
    """Rows that one call of a function in a worker process makes together."""

    keys: Sequence[Row]
    """The columns that say the place of each row."""
    function: Callable[[Any], list[Row]]
    argument: Any


class Plan(NamedTuple):
    """What must be trained and driven for a study's table."""

    inputs: Inputs
    """The settings and drivers of the rows."""
    place: Callable[[Row], tuple[Any, ...]]
    """The sort key of a row, see ``ResultTable``."""
    trainings: "Sequence[TrainingRows]" = ()
    """Trainings that report rows."""
    cells: "Sequence[EpisodeCell]" = ()
    """Evaluation episodes, some of drivers that are trained first."""
    calls: Sequence[Call] = ()


def order_by(
    **columns: Iterable[object] | Callable[[str], Any],
) -> Callable[[Row], tuple[Any, ...]]:
    """Return a function that returns the place of a row: by the first column, then the second, ...

    The argument for a column is either all of its values in their order, or a function that
    converts the text of a cell, such as ``int``. The returned function raises ValueError or
    LookupError for a row with another value or without the column.
    """
    places: dict[str, Callable[[str], Any]] = {
        column: values
        if callable(values)
        else {str(value): place for place, value in enumerate(values)}.__getitem__
        for column, values in columns.items()
    }
    return lambda row: tuple(place(row[column]) for column, place in places.items())


@dataclass(frozen=True, eq=False)
class Program:
    """A study that is a program of its own; ``FileStudy`` has the same attributes.

    It is a table of results, how it is made, and the tables and figures that show it.
    """

    name: str
    """The results are the file NAME.csv; the file NAME.json holds their provenance."""
    meaning: str
    """One sentence for ``python -m studies --help`` and the documentation."""
    row: str
    """The meaning of a row."""
    plan: Callable[[Options], Plan]
    """Returns what must be trained and driven."""
    tables: Mapping[str, Callable[[Path], str]]
    """Functions that return Markdown tables of a results folder, by their marker's name."""
    figures: "Mapping[str, Callable[[Path], Figure]]"
    """Functions that draw a results folder, by the name of the PNG file."""
    derived: Mapping[str, Callable[[list[Row]], list[Row]]] = field(default_factory=dict)
    """Functions that compute further tables from the rows, by file name."""
