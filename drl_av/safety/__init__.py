"""The safety checks: the check that a config names, and a mask of the permitted actions."""

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.config.schema import did_you_mean
from drl_av.driving.actions import ACTIONS
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.safety.assumptions import ROAD_AS_WRITTEN, require_assumptions
from drl_av.safety.check import SafetyCheck, permit_all
from drl_av.safety.paper import paper
from drl_av.safety.strict import Strict
from drl_av.traffic.road import Road
from drl_av.traffic.vehicle_types import AS_WRITTEN, VehicleTypes


def _strict(config: Config, vehicle_types: VehicleTypes, road: Road) -> SafetyCheck:
    check = Strict(config.strict, config.ego, config.simulation)
    require_assumptions(config, vehicle_types, road)
    return check


CHECKS: dict[str, Callable[[Config, VehicleTypes, Road], SafetyCheck]] = {
    "permit_all": lambda config, vehicle_types, road: permit_all,
    "paper": lambda config, vehicle_types, road: partial(paper, config=config.safety),
    "strict": _strict,
}
"""How each safety check is made, by its name, from a config and a scenario's types and road.

To add a check, write its file and add a line here; the command line's help is made from it.
"""


def named_check(
    config: Config, vehicle_types: VehicleTypes = AS_WRITTEN, road: Road = ROAD_AS_WRITTEN
) -> SafetyCheck:
    """The safety check that a config names, for a scenario with these vehicle types and this road.

    Raises:
        ConfigError: there is no check of that name; or it is ``strict``, and an assumption of its
            argument does not hold.
    """
    name = config.safety.check
    if name not in CHECKS:
        raise ConfigError(
            f"safety.check is {name!r}{did_you_mean(name, CHECKS)}, but must be one of: "
            f"{', '.join(CHECKS)}."
        )
    return CHECKS[name](config, vehicle_types, road)


def starts_unsafe(check: SafetyCheck, scene: Scene) -> bool:
    """Whether a check already cannot keep the ego from a collision in a first scene.

    Only ``strict`` can tell: its base case does not hold there. Only a scenario that places its
    vehicles exactly has such starts.
    """
    return isinstance(check, Strict) and not check.fallback_is_free(scene)


ActionMask = npt.NDArray[np.int8]


def action_mask(check: SafetyCheck, scene: Scene) -> ActionMask:
    """1 for each action that the check permits as proposed, else 0; shape (12,), int8.

    ``gymnasium.spaces.Discrete.sample(mask)`` accepts it. All entries are 0 if the check replaces
    every action.
    """
    return np.array([check(scene, action).action == action for action in ACTIONS], np.int8)
