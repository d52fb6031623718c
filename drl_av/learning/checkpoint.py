"""One safetensors file, written whole or not at all, and read without unpickling anything."""

import contextlib
import copy
import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from safetensors import SafetensorError

from drl_av.config import BEFORE, Config, from_toml
from drl_av.errors import CheckpointError, ConfigError
from drl_av.learning.buffers import State
from drl_av.learning.qnetwork import QNetwork

FORMAT = "drl_av/1"
"""The only key of the file's metadata: several would be written in an order that is random."""
_DAMAGE = (SafetensorError, ValueError, LookupError, TypeError, AttributeError, RecursionError)
"""What reading a file that is not as ``save`` wrote it stumbles over."""


def save(path: Path, tensors: State, metadata: dict[str, Any]) -> None:
    """Write named arrays, and metadata that JSON can hold, to ``path``.

    Whatever interrupts it, ``path`` holds either what it held before or all that is new.

    Raises:
        CheckpointError: the disk is full, or the folder is missing or may not be written to.
    """
    tensors = {name: np.asarray(tensor, order="C") for name, tensor in tensors.items()}
    text = json.dumps(metadata, sort_keys=True)
    header = json.dumps({"metadata": text, "sha256": checksum(tensors, text)}, sort_keys=True)
    temporary = path.with_name(f"{path.name}.tmp")
    try:
        try:
            with temporary.open("wb") as file:
                file.write(safetensors.numpy.save(tensors, {FORMAT: header}))
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        _sync_folder(path.parent)
    except OSError as error:
        raise CheckpointError(
            f"The checkpoint {path} cannot be written ({error.strerror or error}): free some "
            "space or choose a folder that may be written to; what was there before is unchanged."
        ) from error


def _sync_folder(folder: Path) -> None:
    """Ask that the new name outlive a power cut; not every file system can be asked."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def checksum(tensors: State, text: str) -> str:
    """SHA-256 over the metadata text and every array's name, type, shape and bytes."""
    digest = hashlib.sha256(text.encode())
    for name in sorted(tensors):
        tensor = tensors[name]
        digest.update(json.dumps([name, tensor.dtype.str, tensor.shape]).encode())
        digest.update(tensor.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def load(path: Path) -> tuple[State, dict[str, Any]]:
    """Read the arrays and the metadata that ``save`` wrote.

    Raises:
        CheckpointError: there is no such file, it cannot be read, is cut short or damaged, or is
            no checkpoint of this package.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CheckpointError(
            f"The checkpoint {path} cannot be read ({error.strerror or error}): check the path."
        ) from error
    try:
        tensors = safetensors.numpy.load(data)
        size = int.from_bytes(data[:8], "little")
        header = json.loads(data[8 : 8 + size]).get("__metadata__", {}).get(FORMAT)
        stored = {"metadata": "", "sha256": ""} if header is None else json.loads(header)
        text, expected = str(stored["metadata"]), stored["sha256"]
        metadata: dict[str, Any] = dict(json.loads(text or "{}"))
    except _DAMAGE as error:
        raise CheckpointError(
            f"{path} is cut short, damaged, or no checkpoint at all ({error}): take an older copy "
            "or train again."
        ) from error
    if header is None:
        raise CheckpointError(
            f"{path} is a safetensors file, but not one of this version of drl-av, whose format "
            f"is {FORMAT!r}: train again, or read it with the version that wrote it."
        )
    if checksum(tensors, text) != expected:
        raise CheckpointError(
            f"{path} is damaged, its checksum does not match its contents: take an older copy or "
            "train again."
        )
    return tensors, metadata


def save_policy(path: Path, networks: Sequence[QNetwork], config: Config) -> None:
    """Write a network's named tensors and the config that built it; raises CheckpointError.

    Those of several networks have one axis more, the first.
    """
    named = [network.state_dict() for network in networks]
    tensors = {name: np.stack([own[name].numpy() for own in named]) for name in named[0]}
    if len(networks) == 1:
        tensors = {name: tensor[0] for name, tensor in tensors.items()}
    save(path, tensors, {"kind": "policy", "config": config.to_toml()})


def load_policy(
    path: Path, observation_size: int = 27, action_size: int = 12
) -> tuple[list[QNetwork], Config]:
    """The networks, one or several, and the config of a policy file.

    Raises:
        CheckpointError: as ``load``; or the file holds no policy, or one of other shapes than
            its config and the sizes given here ask for.
    """
    tensors, metadata = load(path)
    if metadata.get("kind") != "policy":
        raise CheckpointError(
            f"{path} is a checkpoint, but holds no policy: give the policy.safetensors of a run."
        )
    try:
        config = from_toml(str(metadata.get("config")), BEFORE, f"the config in {path}")
    except ConfigError as error:
        raise CheckpointError(
            f"{path} was written with other settings than this version knows: {error}"
        ) from error
    hidden, count = (config.learning.hidden_units,) * 2, config.learning.networks
    network = QNetwork(np.random.default_rng(0), observation_size, action_size, hidden)
    axis = (count,) if count > 1 else ()
    expected = {
        name: ("float32", *axis, *parameter.shape) for name, parameter in network.named_parameters()
    }
    found = {name: (str(tensor.dtype), *tensor.shape) for name, tensor in tensors.items()}
    if found != expected:
        raise CheckpointError(
            f"{path} does not fit a network of {' -> '.join(map(str, network.sizes))}: its "
            f"tensors are {found}, not {expected}; take a policy trained for this observation."
        )
    networks = [network, *(copy.deepcopy(network) for _ in range(count - 1))]
    for number, own in enumerate(networks):
        for name, parameter in own.named_parameters():
            parameter.detach().numpy()[...] = tensors[name][number] if axis else tensors[name]
    return networks, config


def rng_to_json(rng: np.random.Generator) -> dict[str, Any]:
    """The state of a generator as JSON can hold it."""
    state: dict[str, Any] = dict(rng.bit_generator.state)
    return state


def rng_from_json(state: dict[str, Any]) -> np.random.Generator:
    """The generator that goes on where ``rng_to_json`` looked.

    Raises:
        CheckpointError: it is the state of another kind of generator than numpy's default.
    """
    rng = np.random.default_rng()
    try:
        rng.bit_generator.state = state
    except (ValueError, TypeError, KeyError) as error:
        raise CheckpointError(
            f"The stored state of a random generator is not one of {rng.bit_generator}: go on "
            "with the version of numpy the run was started with."
        ) from error
    return rng
