"""Continuous adaptation: what a trained driver brings with it when it goes on learning."""

from pathlib import Path

from drl_av.errors import CheckpointError
from drl_av.learning import checkpoint
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
    else:
        network, _ = checkpoint.load_policy(policy_file)
        flat = network.flat.detach().numpy()
        tensors |= {"learner.online": flat, "learner.target": flat}
    training.restore(tensors, numbers)
    return experienced
