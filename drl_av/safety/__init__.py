"""The safety checks: by the name that a config gives them, and as a mask over the actions."""

from dataclasses import asdict
from functools import partial

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.safety.check import SafetyCheck, permit_all
from drl_av.safety.paper import paper
from drl_av.safety.strict import Strict
from drl_av.traffic.scenario_files import EGO, TRAFFIC, VEHICLE

AT_MOST = {
    "traffic.acceleration_max_m_s2": "strict.acceleration_m_s2",
    "the traffic's hardest braking": "strict.braking_m_s2",
    "the traffic's speed sideways": "strict.lateral_speed_m_s",
    "strict.follower_braking_m_s2": "the traffic's hardest braking",
    "simulation.step_length_s": "strict.follower_response_s",
    "ego.accelerate_m_s2": "what SUMO takes the ego to accelerate at",
    "what SUMO takes the ego to brake at": "ego.hard_brake_m_s2",
}
"""What must not be above what, for the traffic as we write it to keep to the bounds of strict."""


def named_check(config: Config) -> SafetyCheck:
    """The check that a config names.

    Raises:
        ConfigError: ``strict``, and the traffic or the ego do not keep to what it rests on.
    """
    if config.safety.check == "strict":
        check = Strict(config.strict, config.ego, config.simulation)
        require_bounds(config)
        return check
    if config.safety.check == "paper":
        return partial(paper, config=config.safety)
    return permit_all


def require_bounds(config: Config) -> None:
    """Raises ConfigError where a bound of ``strict`` is tighter than what the vehicles do."""
    facts = {
        "the traffic's hardest braking": float(TRAFFIC["decel"]),
        "the traffic's speed sideways": float(VEHICLE["maxSpeedLat"]),
        "what SUMO takes the ego to accelerate at": float(EGO["accel"]),
        "what SUMO takes the ego to brake at": float(EGO["decel"]),
    }
    for section in ("traffic", "strict", "ego", "simulation"):
        settings = asdict(getattr(config, section))
        facts |= {f"{section}.{name}": value for name, value in settings.items()}
    for name, limit in AT_MOST.items():
        if facts[name] > facts[limit]:
            raise ConfigError(
                f"Under the check strict {name} must be at most {limit}, {facts[limit]:g}, and "
                f"not {facts[name]:g}: change one of them, or take the check paper."
            )


ActionMask = npt.NDArray[np.int8]


def action_mask(check: SafetyCheck, scene: Scene) -> ActionMask:
    """1 for each action that the check would execute as proposed, else 0; shape (12,), int8.

    What ``gymnasium.spaces.Discrete.sample(mask)`` takes. All 0 where the check replaces every
    action.
    """
    return np.array([check(scene, action).action == action for action in ACTIONS], np.int8)
