"""Safety triggers of the shipped driver as it goes on learning, and as it does not (Fig. 9)."""

from collections.abc import Generator
from itertools import product
from pathlib import Path
from typing import Any

from drl_av.config import Config
from drl_av.config.presets import adaptation as adapted
from drl_av.drivers.registry import default_config, find_drivers
from drl_av.experiments.legs import Leg, blocks_of
from drl_av.experiments.options import Progress, Scale
from drl_av.experiments.trainings import Table, trained

TABLE = "adaptation.csv"
CHANGES: dict[str, dict[str, Any]] = {"adaptation": {}, "no_adaptation": {"learning_rate": 0.0}}
"""What each of them changes in the settings of ``drl-av adapt``; the traffic is the same."""
BLOCK = 100
"""Episodes that a row of the table sums up."""


def adaptation(scale: Scale) -> Generator[Progress, None, None]:
    """Drive the shipped driver on, with learning and without; as ``trained``.

    As many seeds of it as of the full learning curves, at least one. It goes on with the
    experience of its training, which is trained anew, and has the others' folders within its own.
    """
    shipped = default_config(find_drivers(["pretrained"]))
    origin = _leg("pretrained", scale.over(shipped), scale.runs)
    configs = {
        variant: scale.over(adapted(shipped)).updated("learning", seed=0, **settings)
        for variant, settings in CHANGES.items()
    }
    legs = [
        _leg(variant, configs[variant].updated("learning", seed=seed), origin.folder)._replace(
            every=BLOCK, origin=origin
        )
        for seed, variant in product(range(max(1, scale.full_seeds)), CHANGES)
    ]
    table = Table(scale.out / TABLE, {**configs, origin.variant: origin.config}, blocks_of)
    yield from trained(scale, table, [legs])


def _leg(variant: str, config: Config, within: Path) -> Leg:
    learning = config.learning
    folder = within / f"{variant}-{learning.seed}"
    return Leg(variant, learning.seed, learning.episodes, config, folder, learning.evaluate_every)
