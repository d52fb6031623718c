"""Compares a driver with baselines in the same seeded traffic, episode by episode."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from drl_av.env.metrics import EpisodeResult
from drl_av.errors import DrlAvError, pluralize
from drl_av.evaluation.statistics import Mean, mean_difference
from drl_av.files import Row


class Speed(NamedTuple):
    """The mean speed of one driver in one episode."""

    driver: str
    vehicles: int
    seed: int
    mean_speed_m_s: float


class PairedGain(NamedTuple):
    """The gain in mean speed of a driver over a baseline at one number of vehicles."""

    vehicles: int
    driver: str
    baseline: str
    best: bool
    """Whether this baseline is the fastest at this number of vehicles."""
    episodes: int
    difference_m_s: Mean
    """The driver's speed minus the baseline's in the same traffic; positive if it is faster."""

    @property
    def lower_m_s(self) -> float:
        """Lower end of the 95 % confidence interval of the gain, m/s."""
        return self.difference_m_s.value - self.difference_m_s.half_width

    def row(self) -> Row:
        """Return the gain as a row of ``paired.csv``: text values by column."""
        mean, half = self.difference_m_s
        return {
            "vehicles": str(self.vehicles),
            "driver": self.driver,
            "baseline": self.baseline,
            "best": str(self.best),
            "episodes": str(self.episodes),
            "difference_m_s": f"{mean:.6g}",
            "ci95_half_width_m_s": f"{half:.6g}",
            "lower_m_s": f"{mean - half:.6g}",
            "upper_m_s": f"{mean + half:.6g}",
        }


def require_distinct(rows: Iterable[Speed | EpisodeResult]) -> None:
    """Raise DrlAvError if a driver drove a seed among as many vehicles twice."""
    driven = Counter((row.driver, row.seed, row.vehicles) for row in rows)
    for (driver, seed, vehicles), times in driven.items():
        if times > 1:
            raise DrlAvError(
                f"{driver} drove seed {seed} among {pluralize(vehicles, 'vehicle')} twice: remove "
                "one of the rows."
            )


def paired(
    episodes: Iterable[Speed | EpisodeResult], driver: str, baselines: Sequence[str]
) -> list[PairedGain]:
    """Compute the driver's gain in mean speed over each baseline at each number of vehicles.

    The confidence intervals are Student's t intervals (95 %) of the differences by seed.

    Raises:
        DrlAvError: the drivers did not drive the same seeds, or a driver drove a seed twice.
    """
    episodes = list(episodes)
    require_distinct(episodes)
    speeds: dict[int, dict[str, dict[int, float]]] = {}
    for row in episodes:
        speeds.setdefault(row.vehicles, {}).setdefault(row.driver, {})[row.seed] = (
            row.mean_speed_m_s
        )
    return [
        _gain(vehicles, found, driver, baseline, baselines)
        for vehicles, found in sorted(speeds.items())
        for baseline in baselines
    ]


def _gain(
    vehicles: int,
    found: dict[str, dict[int, float]],
    driver: str,
    baseline: str,
    baselines: Sequence[str],
) -> PairedGain:
    ours, theirs = found.get(driver, {}), found.get(baseline, {})
    names, among = f"{driver} and {baseline}", f" among {pluralize(vehicles, 'vehicle')}"
    difference = mean_difference(ours, theirs, names, among)
    means = {name: sum(found[name].values()) / len(found[name]) for name in baselines}
    return PairedGain(
        vehicles,
        driver,
        baseline,
        baseline == max(means, key=means.__getitem__),
        len(ours),
        difference,
    )
