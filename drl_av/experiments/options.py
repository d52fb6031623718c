"""The options of ``drl-av reproduce``, and how an experiment reports its progress."""

from pathlib import Path
from typing import NamedTuple

from drl_av.config import Config, load_config, located

ENGINES = ("loky", "ray")
"""The programs that distribute the trainings over processes."""
VARIANTS = ("paper", "permit_all", "prioritized")
"""The trainings that the learning curves compare."""


class ReproduceOptions(NamedTuple):
    """The size of an experiment, its number of processes, and the folders of its files."""

    variants: tuple[str, ...] = VARIANTS
    seeds: int = 5
    """Trainings of each variant."""
    episodes: int = 3000
    """Episodes of each training, of a schedule of ``config.learning.episodes``."""
    full_seeds: int = 1
    """Trainings of each variant that continue to the end of the schedule."""
    drives: int = 100
    """Evaluation episodes of each driver at each number of vehicles."""
    jobs: int = 2
    """Processes at once."""
    engine: str = "loky"
    runs: Path = Path("runs/reproduce")
    """Folder of the trainings' own folders, from which they continue."""
    out: Path = Path("docs/results")
    """Folder of the tables, their provenance and the figures."""
    config: str | None = None
    """TOML file with settings that replace those of each experiment."""

    def laid_over(self, config: Config) -> Config:
        """An experiment's settings, changed by the user's file; raises ConfigError."""
        return located(load_config(self.config, config))


class Progress(NamedTuple):
    """The progress of an experiment."""

    done: int
    """Episodes."""
    total: int
    label: str = ""
    """Shown beside the progress bar."""
    line: str = ""
    """Printed above the bar; empty for nothing."""
