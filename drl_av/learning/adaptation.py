"""Continuous adaptation: what a trained driver brings with it when it goes on learning."""

from pathlib import Path

from drl_av.errors import CheckpointError
from drl_av.learning import checkpoint
from drl_av.learning.training import Training


def take_over(training: Training, policy_file: Path) -> None:
    """Begin a training as the driver of a run, whose policy this is, with all that the run kept.

    Algorithm 1 goes on where the run's checkpoint left it: both networks, Adam's moments and the
    experience. Where there is none, the policy is both networks, and experience has to come.

    Raises:
        CheckpointError: a file is damaged, or does not fit the settings of this training.
    """
    tensors, numbers = training.state()
    checkpoint_file = policy_file.with_name("checkpoint.safetensors")
    if checkpoint_file.is_file():
        tensors, found = checkpoint.load(checkpoint_file)
        if found.get("kind") != "training":
            raise CheckpointError(f"{checkpoint_file} is not a training's: put back the run's own.")
    else:
        network, _ = checkpoint.load_policy(policy_file)
        flat = network.flat.detach().numpy()
        tensors |= {"learner.online": flat, "learner.target": flat}
    training.restore(tensors, numbers)
