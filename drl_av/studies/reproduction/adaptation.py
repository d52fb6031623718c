"""Safety triggers of the shipped driver as it goes on learning, and as it does not (Fig. 9)."""

from collections.abc import Generator
from itertools import product
from typing import Any

from drl_av.presets import adaptation as adapted
from drl_av.studies.drivers import PRETRAINED, choose, config_of, policy_file
from drl_av.studies.reproduction.legs import Leg, blocks_of
from drl_av.studies.reproduction.provenance import checksum
from drl_av.studies.reproduction.scale import Progress, Scale
from drl_av.studies.reproduction.trainings import Table, trained

TABLE = "adaptation.csv"
CHANGES: dict[str, dict[str, Any]] = {"adaptation": {}, "no_adaptation": {"learning_rate": 0.0}}
"""What each of them changes in the settings of ``drl-av adapt``; the traffic is the same."""
BLOCK = 100
"""Episodes that a row of the table sums up."""


def adaptation(scale: Scale) -> Generator[Progress, None, None]:
    """Drive the shipped driver on, with learning and without; as ``trained``.

    As many seeds of it as of the full learning curves, at least one.
    """
    config = scale.over(adapted(config_of(choose(["pretrained"]))))
    configs = {
        variant: config.updated("learning", seed=0, **settings)
        for variant, settings in CHANGES.items()
    }
    policy = policy_file(PRETRAINED)
    legs = [
        Leg(
            variant,
            seed,
            config.learning.episodes,
            configs[variant].updated("learning", seed=seed),
            scale.runs / f"{variant}-{seed}",
            BLOCK,
            policy,
        )
        for seed, variant in product(range(max(1, scale.full_seeds)), CHANGES)
    ]
    identity = {"policy_sha256": checksum(policy)}
    yield from trained(scale, Table(scale.out / TABLE, configs, blocks_of, identity), [legs])
