"""The gymnasium environment ``drl_av/Highway-v0``, its reward, and the rollout of an episode."""

from drl_av.env.highway import HighwayEnv

__all__ = ["HighwayEnv"]
