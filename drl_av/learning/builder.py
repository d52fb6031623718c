"""Builds a training from its settings, and can start it from the networks of a trained driver."""

from functools import partial
from pathlib import Path

import numpy as np

from drl_av.config import OLD_DEFAULTS, Config, LearningConfig, from_toml
from drl_av.drivers.learned import considerate, learned_driver
from drl_av.drivers.network import QNetwork
from drl_av.drivers.policy_file import load, load_policy
from drl_av.driving.affordances import observed_indicators
from drl_av.driving.mirror import mirror_of
from drl_av.env.highway import HighwayEnv
from drl_av.errors import CheckpointError
from drl_av.learning.augmentation import (
    StoreCounterfactuals,
    mirror_half,
    require_symmetry,
    unchanged,
)
from drl_av.learning.buffers import Buffer, TwoBuffers, UniformBuffer
from drl_av.learning.experience import StoreDecision, TransitionWriter, TransitionWriterWithPenalty
from drl_av.learning.learner import Learner
from drl_av.learning.prioritized import PrioritizedBuffer
from drl_av.learning.ring import require_memory
from drl_av.learning.training import Training, Variant, draw_seed, learner_names, seed_of_episode


def build_training(env: HighwayEnv) -> Training:
    """Build a new training by Algorithm 1 of the paper, with the settings of ``env.config``.

    All its random numbers come from one generator, seeded with ``learning.seed``.

    Raises:
        ConfigError: ``traffic.vehicles_max`` vehicles do not fit on the road; the experience buffer
            does not fit in the memory; or ``learning.mirrored`` is set, but the reward of a scene
            and of its mirror image differ.
    """
    env.require_room()
    require_symmetry(env.config, env.road)
    config = env.config.learning
    rng = np.random.default_rng(config.seed)
    hidden = (config.hidden_units,) * 2
    names = observed_indicators(env.config.observation)
    networks = [QNetwork(rng, len(names), hidden=hidden) for _ in range(config.networks)]
    learners = [Learner(network, config.learning_rate) for network in networks]
    buffer = make_buffer(config, len(names))
    variant = Variant(
        store=make_store(buffer, env, rng),
        augment=partial(mirror_half, mirror=mirror_of(names)) if config.mirrored else unchanged,
        turns=[[learner] for learner in learners] if config.round_robin else [learners],
        traffic_seed=partial(seed_of_episode, config.seed)
        if config.traffic_by_episode
        else partial(draw_seed, rng),
    )
    driver = learned_driver(networks, env.config)
    if config.permitted_only:
        driver = driver.limited_to(considerate(env.safety_check, env.config.mobil))
    return Training(env, driver, learners, buffer, rng, variant)


def make_buffer(config: LearningConfig, observation_size: int) -> Buffer:
    """Make an empty experience buffer of the kind ``config.replay``.

    Raises:
        ConfigError: the available memory is too small for the full buffer.
    """
    capacity = config.safe_capacity + config.collision_capacity
    require_memory(capacity, observation_size)
    if config.replay == "uniform":
        return UniformBuffer(observation_size, capacity, config.discount)
    if config.replay == "prioritized":
        return PrioritizedBuffer(
            observation_size,
            capacity,
            config.discount,
            config.priority_exponent,
            config.importance_exponent_start,
            config.priority_floor,
        )
    return TwoBuffers(
        observation_size,
        config.safe_capacity,
        config.collision_capacity,
        config.discount,
        config.collision_fraction,
    )


def make_store(buffer: Buffer, env: HighwayEnv, rng: np.random.Generator) -> TransitionWriter:
    """Return the function that stores each decision in ``buffer``, as ``env.config`` demands."""
    config: Config = env.config
    store = (TransitionWriterWithPenalty if config.learning.unsafe_penalty else StoreDecision)(
        buffer, config
    )
    if config.learning.counterfactuals:
        return StoreCounterfactuals(store, buffer, env, rng)
    return store


def warm_start(training: Training, policy_file: Path) -> bool:
    """Load a trained driver into a new training, in place; return whether experience was loaded.

    If the policy file is the ``policy.safetensors`` of a run with a checkpoint, the training gets
    the checkpoint's networks, target networks, Adam moments and experience (returns True).
    Otherwise the online and the target networks are copies of the policy's networks, and the
    buffers stay empty (returns False).

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
        source = f"the config in {checkpoint_file}"
        trained_with = from_toml(str(found.get("config")), OLD_DEFAULTS, source)
    else:
        networks, trained_with = load_policy(policy_file)
        for name, network in zip(learner_names(len(networks)), networks, strict=True):
            tensors |= {f"{name}.online": network.flat, f"{name}.target": network.flat}
    count, wanted = trained_with.learning.networks, training.config.learning.networks
    if count != wanted:
        raise CheckpointError(
            f"{policy_file} was trained with learning.networks = {count}: continue with as many, "
            f"not {wanted}."
        )
    training.restore(tensors, numbers)
    return experienced
