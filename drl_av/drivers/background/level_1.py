"""The level-1 driver that ships with the package, read from its policy file."""

from pathlib import Path

from drl_av.drivers.background.level_k import Level1
from drl_av.drivers.policy_file import load_run
from drl_av.errors import CheckpointError, DrlAvError
from drl_av.traffic.road import Road

LEVEL_1 = Path(__file__).parents[2] / "pretrained" / "level_1"
"""Folder of the shipped policy; laid out as a run's."""


def load_level_1(road: Road, folder: Path = LEVEL_1) -> Level1:
    """The policy of a run's folder as a driver of the traffic on that road.

    Raises:
        CheckpointError: the policy is missing or damaged, holds several networks or none, or
            does not belong to the config beside it.
    """
    try:
        networks, config = load_run(folder)
        if len(networks) > 1:
            raise CheckpointError(f"{folder} holds {len(networks)} networks, not one")
    except DrlAvError as error:
        raise CheckpointError(
            f"The level-1 driver of the traffic cannot be read ({str(error).removesuffix('.')}): "
            "train it again with make level_1, or set traffic.level_1_share to 0."
        ) from error
    return Level1(networks[0].layers, config, road)
