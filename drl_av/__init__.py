"""Learning to drive on a highway, safely, in SUMO.

The packages, each importing only from those before it:

    config, errors   every setting with its source and bounds, and every error
    compiled         functions that numba compiles at their first call
    files            atomic writing, CSV tables
    road             lanes, the state of all vehicles, swept bodies: pure functions
    driving          affordance indicators, actions, lane changes: pure functions
    safety           the safety checks: pure functions
    scenarios        a description becomes SUMO's files, and back
    simulation       vehicles in SUMO; the only package that opens it
    drivers          the drivers of the ego, and the drivers of the background traffic
    twin             the same road and traffic, compiled
    drawing          a scene as a picture, an episode as a film
    env              ``drl_av/Highway-v0``, the gymnasium environment, and its reward
    learning         Algorithm 1 of the paper, and training at scale in the twin; uses torch
    evaluation       drivers in the same traffic, statistics, recordings
    cli              the ``drl-av`` command
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drl_av.drivers.registry import load_driver as load_driver
    from drl_av.env.attach import attach as attach
    from drl_av.env.video import RecordVideo as RecordVideo
    from drl_av.evaluation.evaluate import evaluate as evaluate
    from drl_av.evaluation.trajectories import episode_frame as episode_frame
    from drl_av.learning.train import train as train

__version__ = "0.11.0"
__all__ = ["RecordVideo", "attach", "episode_frame", "evaluate", "load_driver", "train"]

_NAMES = {
    "RecordVideo": "drl_av.env.video",
    "attach": "drl_av.env.attach",
    "episode_frame": "drl_av.evaluation.trajectories",
    "evaluate": "drl_av.evaluation.evaluate",
    "load_driver": "drl_av.drivers.registry",
    "train": "drl_av.learning.train",
}
"""The module of each public name; the first use imports it, and with it SUMO."""

_ON_OPEN_ROADS = (
    *("own_front", "own_rear", "right_front", "right_rear", "left_front", "left_rear", "ego"),
    *("lane_end", "way"),
)
"""Groups of the observation on open roads, in the order of the setting ``observation.way``."""

_CHECKED: dict[str, Any] = {"disable_env_checker": True, "order_enforce": False}
"""The environment itself refuses wrong actions and a step before a reset, so gymnasium does not
wrap it, which saves 6 % of a step with few vehicles."""


def _register_envs() -> None:
    """Register the environments with gymnasium, if that has not been done yet."""
    from gymnasium.envs.registration import register, registry

    kinds: dict[str, dict[str, Any]] = {"drl_av/Highway-v0": {}}
    for name in ("straight", "merge", "exit", "ramp_to_ramp"):
        kind = {"scenario": name, "observation": _ON_OPEN_ROADS}
        kinds[f"drl_av/{name.title().replace('_To_', 'To')}-v0"] = kind
    for name, arguments in kinds.items():
        if name not in registry:
            register(
                name,
                "drl_av.env:HighwayEnv",
                vector_entry_point="drl_av.env.vector:TwinVectorEnv",
                kwargs={"action_mask": True, **arguments},
                **_CHECKED,
            )


def __getattr__(name: str) -> Any:
    if name not in _NAMES:
        raise AttributeError(f"module 'drl_av' has no attribute {name!r}")
    return getattr(import_module(_NAMES[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


_register_envs()
