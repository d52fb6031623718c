"""Continuous adaptation: what a trained driver brings with it when it goes on learning."""

import re
from pathlib import Path

from drl_av.errors import CheckpointError
from drl_av.learning import checkpoint
from drl_av.learning.ensemble import divided
from drl_av.learning.training import Training


def take_over(training: Training, policy_file: Path) -> bool:
    """Begin a training as a driver that was trained, and say whether its experience came along.

    From a run's own ``policy.safetensors`` Algorithm 1 goes on where the run's checkpoint left
    it: both networks, Adam's moments and the experience. Where there is none, or for a policy file
    of another name, the policy is both networks, and experience has to come.

    Raises:
        CheckpointError: a file is damaged, or does not fit the settings of this training.
    """
    tensors, numbers = training.state()
    checkpoint_file = policy_file.with_name("checkpoint.safetensors")
    experienced = policy_file.name == "policy.safetensors" and checkpoint_file.is_file()
    if experienced:
        tensors, found = checkpoint.load(checkpoint_file)
        if found.get("kind") != "training":
            raise CheckpointError(f"{checkpoint_file} is not a training's: put back the run's own.")
        count = sum(re.fullmatch(r"learner\d*\.online", name) is not None for name in tensors)
        _require_as_many(training, policy_file, count)
    else:
        network, trained_with = checkpoint.load_policy(policy_file)
        networks = divided(network, trained_with.learning.networks)
        _require_as_many(training, policy_file, len(networks))
        for learner, own in zip(training.learners, networks, strict=True):
            flat = own.flat.numpy()
            tensors |= {f"{learner}.online": flat, f"{learner}.target": flat}
    training.restore(tensors, numbers)
    return experienced


def _require_as_many(training: Training, policy_file: Path, count: int) -> None:
    if count != len(training.learners):
        raise CheckpointError(
            f"{policy_file} was trained with learning.networks = {count}: go on with as many, "
            f"not {len(training.learners)}."
        )
