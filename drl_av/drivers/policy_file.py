"""Reads and writes policy files and checkpoints: safetensors with a checksum; no code can run."""

import hashlib
import json
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from safetensors import SafetensorError, safe_open

from drl_av.config import Config, from_toml, load_config
from drl_av.drivers.network import Layers, QNetwork
from drl_av.driving.actions import ACTIONS
from drl_av.driving.affordances import observed_indicators
from drl_av.errors import CheckpointError, ConfigError, RunError
from drl_av.files.atomic import write_atomic

State = dict[str, np.ndarray]
"""Arrays by name."""

PRETRAINED = Path(__file__).parent.parent / "pretrained"
"""Folder of the driver that ships with the package, in the layout of a run."""
SHIPPED = {"pretrained": PRETRAINED} | {
    f"pretrained-{name}": PRETRAINED / name for name in ("paper", "merge", "exit", "ramp_to_ramp")
}
"""The folder of each driver that ships with the package, by the driver's name. Two are for the
loop: ``pretrained``, trained at scale; and ``pretrained-paper``, by the paper's algorithm and
schedule. Each of the others is for one kind of road with a ramp."""
FORMAT = "drl_av/1"
"""The only key in the metadata of a file. One key keeps files reproducible: safetensors writes
several keys in random order."""
_AS_IT_IS = "drl-av evaluate and replay drive with this file as it is"
OTHER_FILES = {
    ".zip": ("an agent of stable-baselines3", _AS_IT_IS),
    ".onnx": ("an ONNX network", _AS_IT_IS),
    ".npz": ("a recorded episode", "drl-av replay repeats it"),
    ".toml": ("a file of settings", "pass it as config, or after --config"),
}
"""What a file other than a policy file holds, and how to use it, by suffix."""
LARGEST_WEIGHT = 1e6
"""The largest absolute value of a weight; the values of actions overflow with much larger ones."""
FLOAT32 = np.dtype(np.float32)
_DAMAGE = (SafetensorError, ValueError, LookupError, TypeError, AttributeError, RecursionError)
"""The errors that a damaged file, or a file of another program, can cause."""


def checksum(tensors: State, text: str) -> str:
    """Return the SHA-256, in hex, of the metadata ``text`` and all arrays.

    The hash covers the name, type, shape and bytes of each array.
    """
    digest = hashlib.sha256(text.encode())
    for name in sorted(tensors):
        tensor = tensors[name]
        digest.update(json.dumps([name, tensor.dtype.str, tensor.shape]).encode())
        digest.update(tensor.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def load(path: Path) -> tuple[State, dict[str, Any]]:
    """Read a policy or checkpoint file; return its arrays by name and its metadata.

    Raises:
        CheckpointError: the file is missing, incomplete or damaged (its checksum is wrong), has
            another format, or holds no arrays at all.
    """
    try:
        with safe_open(path, "numpy") as file:
            header = (file.metadata() or {}).get(FORMAT)
            if header is None:
                raise CheckpointError(
                    f"{path} is a safetensors file, but not one of this version of drl-av, whose "
                    f"format is {FORMAT!r}: train again, or read it with the version that wrote it."
                )
            tensors: State = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        stored = json.loads(header)
        text, expected = str(stored["metadata"]), stored["sha256"]
        metadata = dict(json.loads(text))
    except OSError as error:
        raise CheckpointError(
            f"The checkpoint {path} cannot be read ({error.strerror or error}): check the path."
        ) from error
    except _DAMAGE as error:
        raise CheckpointError(
            f"{path} is cut short, damaged, or no checkpoint at all ({error}): take an older copy "
            "or train again."
        ) from error
    if checksum(tensors, text) != expected:
        raise CheckpointError(
            f"{path} is damaged, its checksum does not match its contents: take an older copy or "
            "train again."
        )
    return tensors, metadata


def load_layers(
    path: Path, kind: str, sizes_of: Callable[[Config], Sequence[int]]
) -> tuple[Layers, Config]:
    """Read the layers and the config of a policy file of this kind.

    ``sizes_of`` returns the number of inputs and of the units of each layer by the config.

    Raises:
        CheckpointError: the file cannot be read, is no policy file of this kind, has another config
            than this version knows, or does not fit the network of its own config.
    """
    tensors, metadata = load(path)
    if metadata.get("kind") != kind:
        raise CheckpointError(
            f"{path} is a checkpoint, but holds no policy: give the policy.safetensors of a run."
        )
    try:
        config = from_toml(str(metadata.get("config")), name=f"the config in {path}")
    except ConfigError as error:
        raise CheckpointError(
            f"{path} was written with other settings than this version knows: {error}"
        ) from error
    sizes, expected = sizes_of(config), dict[str, tuple[int, ...]]()
    for number, (inputs, outputs) in enumerate(pairwise(sizes)):
        expected[f"layers.{number}.weight"] = (outputs, inputs)
        expected[f"layers.{number}.bias"] = (outputs,)
    found = {name: tensor.shape for name, tensor in tensors.items()}
    if found != expected or {tensor.dtype for tensor in tensors.values()} != {FLOAT32}:
        raise CheckpointError(
            f"{path} does not fit a network of {' -> '.join(map(str, sizes))}: its tensors are "
            f"{found}, not {expected}; take a policy that drl-av has written for its settings."
        )
    if not all((np.abs(tensor) <= LARGEST_WEIGHT).all() for tensor in tensors.values()):
        raise CheckpointError(
            f"{path} has weights that are no finite numbers or above {LARGEST_WEIGHT:g}: take an "
            "older copy or train again."
        )
    weights = iter(tensors[name] for name in expected)
    return [*zip(weights, weights, strict=True)], config


def load_policy(path: Path) -> tuple[QNetwork, Config]:
    """Read a policy file; return its network and its config.

    Raises:
        CheckpointError: as ``load_layers``.
    """

    def sizes_of(config: Config) -> Sequence[int]:
        hidden = config.learning.hidden_units
        return len(observed_indicators(config.observation)), hidden, hidden, len(ACTIONS)

    layers, config = load_layers(path, "policy", sizes_of)
    inputs, *hidden, _ = sizes_of(config)
    network = QNetwork(np.random.default_rng(0), inputs, hidden=hidden)
    for views, stored in zip(network.layers, layers, strict=True):
        views[0][...], views[1][...] = stored
    return network, config


def save(path: Path, tensors: State, metadata: dict[str, Any]) -> None:
    """Write named arrays, and metadata of JSON types, to the safetensors file ``path`` atomically.

    An interruption at any moment leaves either the complete old file or the complete new one.

    Raises:
        CheckpointError: the disk is full, or the folder is missing or not writable.
    """
    tensors = {name: np.asarray(tensor, order="C") for name, tensor in tensors.items()}
    text = json.dumps(metadata, sort_keys=True)
    header = json.dumps({"metadata": text, "sha256": checksum(tensors, text)}, sort_keys=True)
    write_atomic(path, safetensors.numpy.save(tensors, {FORMAT: header}), CheckpointError)


def save_policy(path: Path, network: QNetwork, config: Config) -> None:
    """Write a policy file: the weights of a network, and its config.

    Raises CheckpointError if the file cannot be written.
    """
    save(path, network.tensors(), {"kind": "policy", "config": config.to_toml()})


def find_policy(path: Path, shipped: str = "pretrained") -> Path:
    """Return ``path/policy.safetensors`` if ``path`` is a folder of a run, else ``path`` itself.

    ``shipped`` is the shipped driver that the message of an error recommends.

    Raises:
        RunError: there is no such run or file, the run has not saved a policy yet, or the file is
            of another kind.
    """
    remedy = f"give a run's folder that has a policy.safetensors, or the shipped {shipped}"
    file = path / "policy.safetensors" if path.is_dir() else path
    if path in SHIPPED.values() and not file.is_file():
        raise RunError(
            f"This installation lacks the driver that ships with drl-av ({file}): train one with "
            "drl-av train --out RUN and name its folder, or name another driver."
        )
    if not path.exists():
        raise RunError(f"There is no file or folder {path}: {remedy}.")
    if (other := OTHER_FILES.get(path.suffix.lower())) and path.is_file():
        content, use = other
        raise RunError(f"{path} is {content}, not a driver that drl-av trained: {remedy}; {use}.")
    if not file.is_file():
        raise RunError(f"{path} holds no trained driver: {remedy}.")
    return file


def load_run(path: Path) -> tuple[QNetwork, Config]:
    """Read the network and the config of a run's folder or of a policy file.

    Raises:
        RunError: there is no policy file, or the file holds something else.
        CheckpointError: the policy file is damaged, or its config differs from ``config.toml`` in
            the folder.
    """
    network, config = load_policy(find_policy(path))
    require_its_settings(path, config)
    return network, config


def require_its_settings(run: Path, config: Config) -> None:
    """Raise CheckpointError if a folder's policy has another config than its ``config.toml``."""
    settings = run / "config.toml"
    if settings.is_file() and load_config(settings) != config:
        raise CheckpointError(
            f"{run / 'policy.safetensors'} belongs to other settings than {settings}: put back the "
            "policy of that run, or name the policy file itself."
        )
