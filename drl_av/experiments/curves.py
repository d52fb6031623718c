"""Learning curves: Algorithm 1 with and without the check, and with another replay (Fig. 7, 9)."""

from collections.abc import Generator
from itertools import product
from typing import Any

from drl_av.config import Config
from drl_av.experiments.convergence import convergence
from drl_av.experiments.legs import Leg, evaluations_of
from drl_av.experiments.options import VARIANTS, Progress, Scale
from drl_av.experiments.tables import write_rows
from drl_av.experiments.trainings import Table, trained
from drl_av.files import Row

CHANGES: dict[str, dict[str, dict[str, Any]]] = {
    "paper": {"safety": {"check": "paper"}, "learning": {"replay": "two-buffer"}},
    "permit_all": {"safety": {"check": "permit_all"}},
    "prioritized": {"learning": {"replay": "prioritized"}},
}
"""What each variant changes in the config."""
TABLE, SUMMARY = "curves.csv", "convergence.csv"


def curves(scale: Scale) -> Generator[Progress, None, None]:
    """Train every variant on every seed, and keep ``curves.csv`` up to date; as ``trained``.

    All of them first go as far as the shorter ones, of the same schedule; then some go on.
    """
    config = scale.over(Config())

    def summarize(rows: list[Row]) -> None:
        write_rows(scale.out / SUMMARY, convergence(rows))

    configs = {variant: variant_config(config, variant) for variant in VARIANTS}
    table = Table(scale.out / TABLE, configs, evaluations_of, written=summarize)
    goals = curve_legs(scale, config)
    short = [leg._replace(stop=min(leg.stop, scale.episodes)) for leg in goals]
    rounds = [short, [leg for leg in goals if leg.stop > scale.episodes]]
    yield from trained(scale, table, rounds)


def variant_config(base: Config, variant: str, seed: int = 0) -> Config:
    """The settings of one training; raises ConfigError."""
    for section, settings in CHANGES[variant].items():
        base = base.updated(section, **settings)
    return base.updated("learning", seed=seed)


def curve_legs(scale: Scale, config: Config) -> list[Leg]:
    """Every training with the last episode that is asked of it."""
    schedule = config.learning.episodes
    return [
        Leg(
            variant,
            seed,
            schedule if seed < scale.full_seeds else min(scale.episodes, schedule),
            variant_config(config, variant, seed),
            scale.runs / f"{variant}-{seed}",
            config.learning.evaluate_every,
        )
        for seed, variant in product(range(scale.seeds), scale.variants)
    ]
