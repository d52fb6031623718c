"""Training at scale: PPO in the twin, in the folder of a run (ours).

The learner is MaskablePPO of sb3-contrib: proximal policy optimization (Schulman et al. 2017,
arXiv:1707.06347) with generalized advantages (Schulman et al. 2016, arXiv:1506.02438) and masked
actions (Huang and Ontanon 2022, arXiv:2006.14171). Its worlds are ``TwinWorlds``.
"""

from collections.abc import Generator
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.config import Config
from drl_av.drivers.learned import INPUTS, KIND
from drl_av.drivers.policy_file import save
from drl_av.driving.wide_observation import EGO_AT, LANES_ASIDE
from drl_av.env.fork import twin_of
from drl_av.errors import ConfigError, needed_by
from drl_av.files.atomic import locked
from drl_av.files.table import append_rows, table_bytes
from drl_av.learning.run_folder import AT_SCALE, made_folder, require_new, require_no_hold

with needed_by("Training at scale", "sb3-contrib", "'drl-av[train]'"):
    import torch
    from sb3_contrib import MaskablePPO
    from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
    from stable_baselines3.common.logger import Logger
    from stable_baselines3.common.torch_layers import MlpExtractor, create_mlp
    from torch import nn

    from drl_av.learning.twin_worlds import TwinWorlds

USED = {"learning": {"algorithm", "seed"}, "reward": set[str](), "observation": {"range_m", "way"}}
"""The settings of some sections that PPO at scale uses."""
SAVES = 20
"""Number of times that a training saves its policy."""


class Progress(NamedTuple):
    """What one update has learned from."""

    decisions: int
    """Decisions so far, in all worlds together."""
    mean_reward: float
    """Mean reward of a decision: 0 at 20 m/s, 1 at 30 m/s, less the costs of ``ppo``.

    It lacks the value that PPO adds where an episode's time is up."""
    collisions: int
    """Episodes so far that ended with a collision."""


def train_at_scale(folder: Path, config: Config) -> Generator[Progress, None, None]:
    """Train a driver by PPO in a new folder; yield after each update.

    The folder holds ``config.toml``, ``updates.csv`` with a row for each update, and
    ``policy.safetensors``. At the end their bytes depend only on the config, on the same machine
    with the same versions. One that is closed early leaves its policy, one that is killed its last.

    Raises:
        ConfigError: ``simulation.world`` is not the twin, the twin cannot do what the settings ask,
            ``observation.way`` is missing on a road whose lanes end or leave, or the numbers of
            ``ppo`` do not fit each other.
        RunError: the folder is not new or cannot be made, or another process trains in it.
        CheckpointError: the policy cannot be written.
    """
    if config.simulation.world != "twin":
        raise ConfigError('PPO at scale trains in the twin: set simulation.world = "twin".')
    road = twin_of("PPO at scale learns", "take --preset paper or paper-merge", config).road
    if road.partial_lanes and not config.observation.way:
        raise ConfigError(
            f"Lanes end or leave on {config.simulation.scenario}: set observation.way = true, as "
            "the preset large-merge does."
        )
    _require_settings(config)
    require_new(folder)
    settings, worlds = config.ppo, TwinWorlds(config, config.learning.seed)
    learner, table = learner_of(config, worlds), folder / AT_SCALE
    updates, policy = settings.decisions // settings.batch_size, folder / "policy.safetensors"
    with made_folder(folder, config) as new:
        (new / AT_SCALE).write_bytes(table_bytes(Progress))
    with locked(folder):
        try:
            for update in range(1, updates + 1):
                paid = worlds.paid
                learner.learn(settings.batch_size, reset_num_timesteps=False)
                mean_reward = (worlds.paid - paid) / settings.batch_size
                progress = Progress(learner.num_timesteps, mean_reward, worlds.collisions)
                if update * SAVES % updates < SAVES:
                    save_actor(policy, learner, config)
                append_rows(table, Progress, [progress])  # the last row says that all is saved
                yield progress
        finally:
            save_actor(policy, learner, config)


def _require_settings(config: Config) -> None:
    """Raise ConfigError if settings would be ignored, or numbers of PPO do not fit each other."""
    require_no_hold(config)
    ppo, kinds = config.ppo, max(len(config.traffic.presets), 1)
    for section, used in USED.items():
        own, usual = asdict(getattr(config, section)), asdict(getattr(Config(), section))
        if others := [name for name in usual.keys() - used if own[name] != usual[name]]:
            raise ConfigError(
                f"{section}.{min(others)} belongs to the training by Algorithm 1, and PPO at scale "
                "would ignore it: leave it out. What PPO pays for stands in [ppo]."
            )
    rest = ppo.batch_size % ppo.worlds + ppo.batch_size % ppo.minibatch_size
    if ppo.worlds < kinds or ppo.decisions < ppo.batch_size or rest:
        raise ConfigError(
            f"ppo.worlds is {ppo.worlds}, minibatch_size {ppo.minibatch_size}, batch_size "
            f"{ppo.batch_size} and decisions {ppo.decisions}: batch_size must be a multiple of the "
            f"first two, decisions at least that, and worlds at least {kinds}, one for each kind "
            "of traffic."
        )


class LaneLayer(nn.Module):
    """A linear layer that sees each of the five lanes with the same weights, and the ego alone.

    Its input are the wide observation and the mask, which counts as the ego's; its output are
    ``units`` numbers of each lane, then of the ego.
    """

    def __init__(self, units: int) -> None:
        super().__init__()
        self.lane = nn.Linear(EGO_AT // len(LANES_ASIDE), units)
        self.ego = nn.Linear(INPUTS - EGO_AT, units)

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the output, shape (rows, 6 * units), of the rows of ``seen``."""
        lanes = seen[:, :EGO_AT].reshape(-1, len(LANES_ASIDE), self.lane.in_features)
        return torch.cat((self.lane(lanes).flatten(1), self.ego(seen[:, EGO_AT:])), dim=1)

    def dense(self) -> nn.Linear:
        """Return a fully connected layer with the same output."""
        groups = *[self.lane] * len(LANES_ASIDE), self.ego
        weights = [group.weight.data for group in groups]
        weight = torch.block_diag(*weights)  # type: ignore[no-untyped-call]
        layer = nn.Linear(INPUTS, len(weight))
        layer.weight.data = weight
        layer.bias.data = torch.cat([group.bias.data for group in groups])
        return layer


class Towers(MlpExtractor):
    """The hidden layers of the critic, and of the actor, which sees the first inputs only."""

    def __init__(self, actor_inputs: int, lane_units: int, inputs: int, hidden: list[int]) -> None:
        super().__init__(inputs, hidden, nn.LeakyReLU, device="cpu")
        self._actor_inputs = actor_inputs
        first: list[nn.Module] = []
        if lane_units:
            first = [LaneLayer(lane_units), nn.LeakyReLU()]
            actor_inputs = (len(LANES_ASIDE) + 1) * lane_units
        self.policy_net = nn.Sequential(*first, *create_mlp(actor_inputs, 0, hidden, nn.LeakyReLU))

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Return the last hidden layer of the actor."""
        return super().forward_actor(features[:, : self._actor_inputs])


class AsymmetricPolicy(MaskableActorCriticPolicy):
    """The policy of MaskablePPO, whose actor sees the first ``actor_inputs`` numbers only."""

    def __init__(self, *args: Any, actor_inputs: int, lane_units: int, **kwargs: Any) -> None:
        self._actor = actor_inputs, lane_units
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        assert isinstance(self.net_arch, list)
        self.mlp_extractor = Towers(*self._actor, self.features_dim, self.net_arch)


def learner_of(config: Config, worlds: TwinWorlds) -> MaskablePPO:
    """Return the learner that ``config.ppo`` describes."""
    torch.set_num_threads(1)
    settings = config.ppo

    def rate(_: float) -> float:
        before = learner.num_timesteps - settings.batch_size
        return settings.learning_rate * max(1.0 - before / settings.decisions, 0.0)

    learner = MaskablePPO(
        AsymmetricPolicy,
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
            "actor_inputs": worlds.SIZE,
            "lane_units": settings.lane_units,
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
    dense = (part.dense() if isinstance(part, LaneLayer) else part for part in parts)
    layers = [layer for layer in dense if isinstance(layer, nn.Linear)]
    tensors = {
        f"layers.{number}.{name}": tensor.detach().numpy()
        for number, layer in enumerate(layers)
        for name, tensor in layer.named_parameters()
    }
    save(path, tensors, {"kind": KIND, "config": config.to_toml()})
