"""The safety checks: the check that a config names, and a mask of the permitted actions."""

from collections.abc import Callable
from dataclasses import asdict
from functools import partial

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.config.schema import did_you_mean
from drl_av.driving.actions import ACTIONS
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.safety.check import SafetyCheck, permit_all
from drl_av.safety.paper import paper
from drl_av.safety.strict import Strict
from drl_av.traffic.vehicle_types import AS_WRITTEN, VehicleType, VehicleTypes

AT_MOST = {
    "traffic.acceleration_max_m_s2": "strict.acceleration_m_s2",
    "the decel of the vehicle type traffic": "strict.braking_m_s2",
    "the emergencyDecel of the vehicle type traffic": "strict.braking_m_s2",
    "the maxSpeedLat of the vehicle type traffic": "strict.lateral_speed_m_s",
    "strict.follower_braking_m_s2": "the decel of the vehicle type traffic",
    "simulation.step_length_s": "strict.follower_response_s",
    "ego.accelerate_m_s2": "the accel of the vehicle type ego",
    "the decel of the vehicle type ego": "ego.hard_brake_m_s2",
}
"""Each name must not exceed the other, so that the vehicles keep to the bounds of ``strict``."""


def _strict(config: Config, vehicle_types: VehicleTypes) -> SafetyCheck:
    check = Strict(config.strict, config.ego, config.simulation)
    require_bounds(config, vehicle_types)
    return check


CHECKS: dict[str, Callable[[Config, VehicleTypes], SafetyCheck]] = {
    "permit_all": lambda config, vehicle_types: permit_all,
    "paper": lambda config, vehicle_types: partial(paper, config=config.safety),
    "strict": _strict,
}
"""How each safety check is made from a config and the vehicle types of a scenario, by its name.

To add a check, write its file and add a line here; the command line's help is made from it.
"""


def named_check(config: Config, vehicle_types: VehicleTypes = AS_WRITTEN) -> SafetyCheck:
    """The safety check that a config names, for a scenario with these vehicle types.

    Raises:
        ConfigError: there is no check of that name; or it is ``strict``, and the traffic or the
            ego breaks its assumptions.
    """
    name = config.safety.check
    if name not in CHECKS:
        raise ConfigError(
            f"safety.check is {name!r}{did_you_mean(name, CHECKS)}, but must be one of: "
            f"{', '.join(CHECKS)}."
        )
    return CHECKS[name](config, vehicle_types)


def require_bounds(config: Config, vehicle_types: VehicleTypes) -> None:
    """Raise ConfigError if the vehicles can exceed a bound of ``strict``."""
    traffic, ego = vehicle_types.traffic, vehicle_types.ego
    facts = {
        "the decel of the vehicle type traffic": traffic.braking_m_s2,
        "the emergencyDecel of the vehicle type traffic": traffic.emergency_braking_m_s2,
        "the maxSpeedLat of the vehicle type traffic": traffic.lateral_speed_m_s,
        "the accel of the vehicle type ego": ego.acceleration_m_s2,
        "the decel of the vehicle type ego": ego.braking_m_s2,
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
    for name in ("traffic", "ego"):
        _require_model(name, getattr(vehicle_types, name), getattr(AS_WRITTEN, name))


def _require_model(name: str, found: VehicleType, written: VehicleType) -> None:
    changed = sorted(set(found.model) ^ set(written.model))
    if changed:
        key = changed[0][0]
        values = [dict(kind.model).get(key, "the default of SUMO") for kind in (written, found)]
        raise ConfigError(
            f"Under the check strict the {key} of the vehicle type {name} must be {values[0]}, "
            f"and not {values[1]}: undo the change, or take the check paper."
        )


ActionMask = npt.NDArray[np.int8]


def action_mask(check: SafetyCheck, scene: Scene) -> ActionMask:
    """1 for each action that the check permits as proposed, else 0; shape (12,), int8.

    ``gymnasium.spaces.Discrete.sample(mask)`` accepts it. All entries are 0 if the check replaces
    every action.
    """
    return np.array([check(scene, action).action == action for action in ACTIONS], np.int8)
