"""The experience buffer that the settings name."""

from drl_av.config import LearningConfig
from drl_av.learning.buffers import Buffer, TwoBuffers, UniformBuffer
from drl_av.learning.prioritized import PrioritizedBuffer


def make_buffer(config: LearningConfig, observation_size: int) -> Buffer:
    """The empty buffer that ``config.replay`` names; with one ring it has room for both kinds."""
    capacity = config.safe_capacity + config.collision_capacity
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
