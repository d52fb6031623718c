"""What the trainings of the learning curves end in: their drivers, in the evaluation's traffic."""

from collections.abc import Generator

from drl_av.config import Config
from drl_av.experiments.curves import curve_legs
from drl_av.experiments.options import Progress, Scale
from drl_av.experiments.trained_drivers import drive_trained

TABLE = "ends.csv"
OUTCOME = ("seed", "mean_reward", "mean_speed_m_s", "collided", "ego_hit")
"""What is kept of an episode."""


def ends(scale: Scale) -> Generator[Progress, None, None]:
    """Drive each with the check that it learnt with, and keep ``ends.csv`` up to date.

    The trainings are those of the learning curves that stop at ``scale.episodes``, and go on from
    there.

    Raises:
        DrlAvError, SimulationError: as ``drive_trained``.
    """
    legs = curve_legs(scale, scale.over(Config()))
    stopped = [leg for leg in legs if leg.stop <= scale.episodes]
    if not stopped:
        told = f"No training stops at episode {scale.episodes}: ends needs more --seeds."
        yield Progress(1, 1, line=told)
    yield from drive_trained(scale, TABLE, stopped, OUTCOME)
