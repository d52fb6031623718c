"""Safety triggers of the shipped driver as it goes on learning, and as it does not (Fig. 9)."""

from collections.abc import Generator
from contextlib import closing
from itertools import product
from typing import Any

from drl_av.config import Config
from drl_av.presets import adaptation as adapted
from drl_av.studies.drivers import PRETRAINED, choose, config_of, policy_file
from drl_av.studies.reproduction.engines import ENGINES
from drl_av.studies.reproduction.legs import Leg, blocks_of, drive_leg, episodes_driven
from drl_av.studies.reproduction.provenance import checksum
from drl_av.studies.reproduction.scale import Progress, Scale
from drl_av.studies.reproduction.trainings import Table, missing, trained

TABLE = "adaptation.csv"
CHANGES: dict[str, dict[str, Any]] = {"adaptation": {}, "no_adaptation": {"learning_rate": 0.0}}
"""What each of them changes in the settings of ``drl-av adapt``; the traffic is the same."""
BLOCK = 100
"""Episodes that a row of the table sums up."""


def adaptation(scale: Scale) -> Generator[Progress, None, None]:
    """Drive the shipped driver on, with learning and without; as ``trained``.

    As many seeds of it as of the full learning curves, at least one. It goes on with the
    experience of its training, which is trained anew where its folder is not there.
    """
    shipped = config_of(choose(["pretrained"]))
    origin = _training(scale, "pretrained", scale.over(shipped))
    configs = {
        variant: scale.over(adapted(shipped)).updated("learning", seed=0, **settings)
        for variant, settings in CHANGES.items()
    }
    legs = [
        _training(scale, variant, configs[variant].updated("learning", seed=seed))._replace(
            every=BLOCK, policy=origin.folder / "policy.safetensors"
        )
        for seed, variant in product(range(max(1, scale.full_seeds)), CHANGES)
    ]
    identity = {"policy_sha256": checksum(policy_file(PRETRAINED))}
    table = Table(scale.out / TABLE, configs, blocks_of, identity)
    if missing(table, legs):
        with closing(ENGINES[scale.engine](drive_leg, [origin], 1)) as engine:
            for _ in engine:
                yield Progress(episodes_driven(origin.folder), origin.stop, "the shipped driver")
    yield from trained(scale, table, [legs])


def _training(scale: Scale, variant: str, config: Config) -> Leg:
    learning = config.learning
    folder = scale.runs / f"{variant}-{learning.seed}"
    return Leg(variant, learning.seed, learning.episodes, config, folder, learning.evaluate_every)
