"""Training at scale: PPO in the twin, in the folder of a run (ours).

The learner is MaskablePPO of sb3-contrib: proximal policy optimization (Schulman et al. 2017,
arXiv:1707.06347) with generalized advantages (Schulman et al. 2016, arXiv:1506.02438) and masked
actions (Huang and Ontanon 2022, arXiv:2006.14171).
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from drl_av.config import Config
from drl_av.config.reference import annotated_toml
from drl_av.drivers.masked_policy import KIND
from drl_av.drivers.policy_file import save
from drl_av.errors import ConfigError, DrlAvError, RunError
from drl_av.files import append_rows, table_bytes

try:
    import torch
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.logger import Logger
    from torch import nn

    from drl_av.learning.twin_worlds import TwinWorlds
except ImportError as error:
    raise DrlAvError(
        "Training at scale needs sb3-contrib, which is not installed: pip install 'drl-av[train]'."
    ) from error

SAVES = 20
"""Number of times that a training saves its policy."""


class Progress(NamedTuple):
    """What one update has learned from."""

    decisions: int
    """Decisions so far, in all worlds together."""
    mean_reward: float
    """Mean reward of a decision, as ``TwinWorlds`` scales it."""
    collisions: int
    """Episodes so far that ended with a collision."""


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
    settings, worlds = config.ppo, TwinWorlds(config, config.learning.seed)
    learner = learner_of(config, worlds)
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
    updates = settings.decisions // settings.batch_size
    for update in range(1, updates + 1):
        learner.learn(settings.batch_size, reset_num_timesteps=False)
        buffer = learner.rollout_buffer
        progress = Progress(learner.num_timesteps, float(buffer.rewards.mean()), worlds.collisions)
        append_rows(table, Progress, [progress])
        if update * SAVES % updates < SAVES:
            save_actor(folder / "policy.safetensors", learner, config)
        yield progress


def learner_of(config: Config, worlds: TwinWorlds) -> MaskablePPO:
    """Return the learner that ``config.ppo`` describes."""
    torch.set_num_threads(1)
    settings = config.ppo

    def rate(_: float) -> float:
        return settings.learning_rate * (1.0 - learner.num_timesteps / settings.decisions)

    learner = MaskablePPO(
        "MlpPolicy",
        worlds,
        learning_rate=settings.learning_rate,
        n_steps=settings.batch_size // settings.worlds,
        batch_size=settings.minibatch_size,
        n_epochs=settings.epochs,
        gamma=settings.discount,
        gae_lambda=settings.gae_lambda,
        ent_coef=settings.entropy,
        policy_kwargs={
            "net_arch": [settings.hidden_1, settings.hidden_2],
            "activation_fn": nn.LeakyReLU,
        },
        seed=config.learning.seed,
        device="cpu",
    )
    learner.lr_schedule = rate
    learner.set_logger(Logger(None, []))
    return learner


def save_actor(path: Path, learner: MaskablePPO, config: Config) -> None:
    """Write the actor's weights and the config to a policy file.

    Raises CheckpointError if the file cannot be written.
    """
    parts = *learner.policy.mlp_extractor.policy_net, learner.policy.action_net
    layers = [layer for layer in parts if isinstance(layer, nn.Linear)]
    tensors = {
        f"layers.{number}.{name}": tensor.detach().numpy()
        for number, layer in enumerate(layers)
        for name, tensor in layer.named_parameters()
    }
    save(path, tensors, {"kind": KIND, "config": config.to_toml()})
