"""Writes checkpoints and policies atomically, and saves the state of random generators."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy

from drl_av.config import Config
from drl_av.drivers.network import QNetwork
from drl_av.drivers.policy_file import FORMAT, State, checksum
from drl_av.errors import CheckpointError
from drl_av.files import write_atomic


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


def save_policy(path: Path, networks: Sequence[QNetwork], config: Config) -> None:
    """Write a policy file: the weights of the networks, and their config.

    The arrays of several networks have an additional first axis, the network. Raises
    CheckpointError if the file cannot be written.
    """
    named = [network.tensors() for network in networks]
    tensors = {name: np.stack([own[name] for own in named]) for name in named[0]}
    if len(networks) == 1:
        tensors = {name: tensor[0] for name, tensor in tensors.items()}
    save(path, tensors, {"kind": "policy", "config": config.to_toml()})


def rng_to_json(rng: np.random.Generator) -> dict[str, Any]:
    """Return the state of a random generator as a dictionary that JSON can hold."""
    state: dict[str, Any] = dict(rng.bit_generator.state)
    return state


def restore_rng(rng: np.random.Generator, state: dict[str, Any]) -> None:
    """Set a random generator, in place, to the state that ``rng_to_json`` returned.

    Raises:
        CheckpointError: ``state`` belongs to another kind of generator.
    """
    try:
        rng.bit_generator.state = state
    except (ValueError, TypeError, KeyError) as error:
        raise CheckpointError(
            f"The stored state of a random generator is not one of {rng.bit_generator}: continue "
            "with the version of numpy the run was started with."
        ) from error
