"""Continuous adaptation: what a trained driver brings with it when it goes on learning."""

from pathlib import Path

from drl_av.config import BEFORE, from_toml
from drl_av.drivers.policy_file import load, load_policy
from drl_av.errors import CheckpointError
from drl_av.learning.training import Training, learner_names


def take_over(training: Training, policy_file: Path) -> bool:
    """Begin a training as a driver that was trained, and say whether its experience came along.

    From a run's own ``policy.safetensors`` Algorithm 1 goes on where the run's checkpoint left
    it: each network and its target, Adam's moments and the experience. Where there is none, or for
    a policy file of another name, the policy is both, and experience has to come.

    Raises:
        CheckpointError: a file is damaged, or does not fit the settings of this training.
        ConfigError: the run has settings that this version does not know.
    """
    tensors, numbers = training.state()
    checkpoint_file = policy_file.with_name("checkpoint.safetensors")
    experienced = policy_file.name == "policy.safetensors" and checkpoint_file.is_file()
    if experienced:
        tensors, found = load(checkpoint_file)
        if found.get("kind") != "training":
            raise CheckpointError(f"{checkpoint_file} is not a training's: put back the run's own.")
        told = f"the config in {checkpoint_file}"
        trained_with = from_toml(str(found.get("config")), BEFORE, told)
    else:
        networks, trained_with = load_policy(policy_file)
        for name, network in zip(learner_names(len(networks)), networks, strict=True):
            flat = network.flat
            tensors |= {f"{name}.online": flat, f"{name}.target": flat}
    count, wanted = trained_with.learning.networks, training.config.learning.networks
    if count != wanted:
        raise CheckpointError(
            f"{policy_file} was trained with learning.networks = {count}: go on with as many, "
            f"not {wanted}."
        )
    training.restore(tensors, numbers)
    return experienced
