"""What ``drl-av reproduce`` is asked for, and what its experiments tell meanwhile."""

from collections.abc import Callable, Generator
from pathlib import Path
from typing import NamedTuple

from drl_av.config import Config, load_config, located

MEANINGS = {
    "curves": "learning curves: with and without the check, two buffers and prioritized replay",
    "ends": "what the trainings of the curves end in: each driver in the traffic of the evaluation",
    "fast": "the preset fast on every seed, beside the driver of the whole schedule of 10000",
    "speeds": "mean speed against the number of vehicles, to where the drivers meet",
    "variations": "drivers without check, by cruise control, with v_des exact, at a closed lane",
    "strict": "what the check strict costs the shipped driver, and each of its bounds",
    "adaptation": "safety triggers of the shipped driver with and without learning on",
    "barricade": "learning beside a closed lane, with the check and without",
    "figures": "what can be drawn of these",
}
"""What there is to reproduce."""
VARIANTS = ("paper", "permit_all", "prioritized")
"""The trainings that the learning curves compare."""
ENGINES = ("loky", "ray")
"""What spreads the trainings over processes."""


class Scale(NamedTuple):
    """How much of it is made, with what, and where to."""

    variants: tuple[str, ...] = VARIANTS
    seeds: int = 5
    """Trainings of each variant."""
    episodes: int = 3000
    """Episodes of each training, of a schedule of ``config.learning.episodes``."""
    full_seeds: int = 1
    """Trainings of each variant that go on to the end of the schedule."""
    drives: int = 100
    """Evaluation episodes of each driver at each number of vehicles."""
    jobs: int = 2
    engine: str = "loky"
    runs: Path = Path("runs/reproduce")
    """Folder of the trainings' own folders: working state, from which they go on."""
    out: Path = Path("docs/results")
    """Folder of the CSV files, their provenance and the figures."""
    config: str | None = None
    """TOML file of settings that are laid over those of each experiment."""

    def over(self, config: Config) -> Config:
        """An experiment's settings as they are asked for; raises ConfigError."""
        return located(load_config(self.config, config))


class Progress(NamedTuple):
    """Where an experiment is."""

    done: int
    total: int
    told: str = ""
    """What stands beside the bar."""
    line: str = ""
    """What is said once; empty for nothing."""


Experiment = Callable[[Scale], Generator[Progress, None, None]]
