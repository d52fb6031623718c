"""The preset ``fast`` on several seeds, beside the driver of the paper's whole schedule (ours)."""

from collections.abc import Generator
from pathlib import Path

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.experiments.curves import variant_config
from drl_av.experiments.legs import Leg
from drl_av.experiments.options import Progress, Scale
from drl_av.experiments.trained_drivers import drive_trained

TABLE = "fast.csv"
OUTCOME = ("seed", "mean_reward", "mean_speed_m_s", "ego_hit")
"""What is kept of an episode."""


def fast(scale: Scale) -> Generator[Progress, None, None]:
    """Train both, drive all through the same traffic, and keep ``fast.csv`` up to date.

    The long training is that of the learning curves, seed 0, and goes on from there.

    Raises:
        DrlAvError, SimulationError: as ``drive_trained``.
    """
    yield from drive_trained(scale, TABLE, _legs(scale), OUTCOME)


def _legs(scale: Scale) -> list[Leg]:
    """The long training first, then ``fast`` on every seed."""
    long = variant_config(scale.over(Config()), "paper")
    short = scale.over(preset("fast"))
    configs = {"paper-0": long} | {
        f"fast-{seed}": short.updated("learning", seed=seed) for seed in range(scale.seeds)
    }
    return [_leg(scale.runs / name, config) for name, config in configs.items()]


def _leg(folder: Path, config: Config) -> Leg:
    learning, variant = config.learning, folder.name.partition("-")[0]
    episodes, every = learning.episodes, learning.evaluate_every
    return Leg(variant, learning.seed, episodes, config, folder, every)
