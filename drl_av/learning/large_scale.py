"""Training at scale: PPO in the twin, in the folder of a run (ours)."""

from collections.abc import Iterator
from pathlib import Path

from torch import nn

from drl_av.config import Config
from drl_av.config.reference import annotated_toml
from drl_av.drivers.masked_policy import KIND
from drl_av.drivers.policy_file import save
from drl_av.errors import ConfigError, RunError
from drl_av.files import append_rows, table_bytes
from drl_av.learning.ppo import Ppo, Progress
from drl_av.learning.twin_worlds import TwinWorlds

SAVES = 20
"""Number of times that a training saves its policy."""


def train_at_scale(folder: Path, config: Config) -> Iterator[Progress]:
    """Train a driver by PPO in a new folder; yield after each update.

    The folder holds ``config.toml``, ``updates.csv`` with a row for each update, and
    ``policy.safetensors``. At the end their bytes depend only on the config, on the same machine
    with the same versions. A training that is stopped leaves the policy of its last twentieth part.

    Raises:
        ConfigError: ``simulation.world`` is not the twin.
        RunError: the folder exists and is not empty, or cannot be made.
        CheckpointError: the policy cannot be written.
    """
    if config.simulation.world != "twin":
        raise ConfigError('PPO at scale trains in the twin: set simulation.world = "twin".')
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise RunError(f"{folder} exists already: choose another folder with --out.")
    learner = Ppo(TwinWorlds(config, config.learning.seed), config.ppo, config.learning.seed)
    table = folder / "updates.csv"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "config.toml").write_text(annotated_toml(config), encoding="utf-8")
        table.write_bytes(table_bytes(Progress))
    except OSError as error:
        raise RunError(
            f"The run folder {folder} cannot be made ({error.strerror}): choose another folder "
            "with --out."
        ) from error
    for update, progress in enumerate(learner.learn(), start=1):
        append_rows(table, Progress, [progress])
        if update * SAVES % learner.updates < SAVES:
            save_actor(folder / "policy.safetensors", learner, config)
        yield progress


def save_actor(path: Path, learner: Ppo, config: Config) -> None:
    """Write the actor's weights and the config to a policy file.

    Raises CheckpointError if the file cannot be written.
    """
    layers = [layer for layer in learner.model.actor if isinstance(layer, nn.Linear)]
    tensors = {
        f"layers.{number}.{name}": tensor.detach().numpy()
        for number, layer in enumerate(layers)
        for name, tensor in layer.named_parameters()
    }
    save(path, tensors, {"kind": KIND, "config": config.to_toml()})
