"""The level-1 driver that ships with the package: a policy file read without torch."""

from pathlib import Path

import safetensors.numpy
from safetensors import SafetensorError

from drl_av.config import BEFORE, load_config
from drl_av.drivers.background.level_k import Layers, Level1
from drl_av.driving.actions import ACTIONS
from drl_av.driving.affordances import INDICATORS
from drl_av.errors import CheckpointError
from drl_av.traffic.road import Road

LEVEL_1 = Path(__file__).parents[2] / "pretrained" / "level_1"
"""Folder of the shipped policy; laid out as a run's."""


def load_level_1(road: Road, folder: Path = LEVEL_1) -> Level1:
    """The policy of a run's folder as a driver of the traffic on that road.

    Raises:
        CheckpointError: the file is missing or damaged, or holds no policy.
        ConfigError: so is the config beside it.
    """
    file = folder / "policy.safetensors"
    try:
        tensors = safetensors.numpy.load(file.read_bytes())
        layers = [
            (tensors[f"layers.{i}.weight"], tensors[f"layers.{i}.bias"])
            for i in range(len(tensors) // 2)
        ]
        _require_shapes(layers)
    except (OSError, SafetensorError, LookupError, ValueError) as error:
        raise CheckpointError(
            f"The level-1 driver {file} is missing, damaged, or no policy ({error}): train it "
            "again with make level_1, or set traffic.level_1_share to 0."
        ) from error
    return Level1(layers, load_config(folder / "config.toml", BEFORE), road)


def _require_shapes(layers: Layers) -> None:
    """Raise ValueError unless the layers lead from the 27 indicators to the 12 actions."""
    sizes = [len(INDICATORS), *(len(bias) for _, bias in layers)]
    shapes = [weight.shape for weight, _ in layers]
    if sizes[-1] != len(ACTIONS) or shapes != list(zip(sizes[1:], sizes[:-1], strict=True)):
        raise ValueError(f"its layers are {shapes}")
