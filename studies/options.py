"""The options of ``python -m studies``, and the progress that an experiment reports."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from drl_av.config import Config, with_files
from drl_av.drivers.registry import default_config, find_drivers
from drl_av.scenarios.folder import with_scenario

ENGINES = ("loky", "ray")
"""The libraries that can distribute the trainings over processes."""
VARIANTS = ("paper", "permit_all", "prioritized")
"""The variants of training that the learning curves compare, see ``experiments.curves``."""


class ReproduceOptions(NamedTuple):
    """The size of an experiment, its number of processes, and the folders of its files."""

    variants: tuple[str, ...] = VARIANTS
    seeds: int = 5
    """Number of trainings of each variant."""
    episodes: int = 3000
    """Episodes of each training; its schedule is still ``config.learning.episodes`` long."""
    full_seeds: int = 1
    """Number of trainings of each variant that continue to the end of the schedule."""
    drives: int = 100
    """Evaluation episodes of each driver at each number of vehicles."""
    jobs: int = 2
    """Number of processes."""
    engine: str = "loky"
    runs: Path = Path("runs/reproduce")
    """Folder of the trainings' folders; a training continues from its folder."""
    out: Path = Path("docs/results")
    """Folder of the tables, their provenance and the figures."""
    config: tuple[str, ...] = ()
    """TOML files with settings that replace those of each experiment, in this order."""

    def with_files(self, config: Config) -> Config:
        """Return the settings of an experiment, changed by the user's TOML files.

        Raises ConfigError if a file or a setting in it is wrong.
        """
        return with_scenario(with_files(config, self.config))

    def settings_of(self, drivers: Iterable[str]) -> Config:
        """Return the settings with which ``drivers`` drive in an experiment.

        They are those of the first learned driver, or the defaults without one, with the check
        ``paper`` and the changes of the user's TOML files.

        Raises ConfigError if a file or a setting in it is wrong.
        """
        config = default_config(find_drivers(drivers))
        return self.with_files(config.updated("safety", check="paper"))


class Progress(NamedTuple):
    """The progress of an experiment, for the progress bar."""

    done: int
    """Number of episodes driven; ``total`` is the number to drive."""
    total: int
    label: str = ""
    """Text beside the progress bar."""
    line: str = ""
    """A line to print above the bar; empty for none."""
