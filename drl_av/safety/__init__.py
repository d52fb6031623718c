"""The safety checks: creation of the check that a config names, and the action mask."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.config.functions import is_factory
from drl_av.config.section import not_one_of
from drl_av.driving.actions import ACTIONS
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.road.road import Road
from drl_av.road.vehicle_types import AS_WRITTEN, VehicleTypes
from drl_av.safety.assumptions import ROAD_AS_WRITTEN, require_assumptions
from drl_av.safety.check import SafetyCheck, Verdicts, apply_check, permit_all, whole_verdicts
from drl_av.safety.paper import Paper, PaperBeforeLaneEnds
from drl_av.safety.strict import Strict


def _strict(config: Config, vehicle_types: VehicleTypes, road: Road) -> SafetyCheck:
    """Create the check ``strict``; raise ConfigError if one of its assumptions does not hold."""
    check = Strict(config.strict, config.ego, config.simulation)
    require_assumptions(config, vehicle_types, road)
    return check


CHECKS: dict[str, Callable[[Config, VehicleTypes, Road], SafetyCheck]] = {
    "permit_all": lambda config, vehicle_types, road: permit_all,
    "paper": lambda config, vehicle_types, road: (
        Paper(config.safety) if road.is_loop else PaperBeforeLaneEnds(config)
    ),
    "strict": _strict,
}
"""The function that creates each safety check, by name.

Its arguments are a config, and the vehicle types and the road of a scenario. To add a check, write
its file and add a line here; the help of the command line lists the names.
"""


def named_check(
    config: Config, vehicle_types: VehicleTypes = AS_WRITTEN, road: Road = ROAD_AS_WRITTEN
) -> SafetyCheck:
    """Return the safety check that a config names, for a scenario's vehicle types and road.

    Raises:
        ConfigError: there is no check of that name; or it is ``strict``, and an assumption of its
            safety proof (docs/safety.md) does not hold.
    """
    name = config.safety.check
    if ":" in name:
        by_name = f"name it with --safety-check {name} (safety_check=)"
        way = by_name if is_factory(name) else "pass it as safety_check= of Python"
        raise ConfigError(
            f"safety.check is {name!r}, a function of a user, which no file may run: {way} if you "
            "trust it, or another one (RUN@paper); within a function that makes a check, name "
            "another one: config.updated('safety', check='paper')."
        )
    if name not in CHECKS:
        raise ConfigError(not_one_of("safety.check", name, CHECKS))
    check, *_ = (CHECKS[name](each, vehicle_types, road) for each in config.per_traffic_preset)
    return check  # equal for each kind of traffic, but each may break an assumption


ActionMask = npt.NDArray[np.int8]
"""Shape (12,); 1 for each action that the safety check permits, else 0."""


def action_mask(check: SafetyCheck, scene: Scene) -> ActionMask:
    """Return 1 for each action that the check permits as proposed, else 0; shape (12,), int8.

    The argument ``mask`` of ``gymnasium.spaces.Discrete.sample`` accepts it. All entries are 0 if
    the check replaces every action.
    """
    if (verdicts := whole_verdicts(check, scene)) is not None:
        return mask_of(verdicts)
    permitted = [apply_check(check, scene, action).action == action for action in ACTIONS]
    return np.array(permitted, np.int8)


def mask_of(verdicts: Verdicts) -> ActionMask:
    """Return the action mask that follows from the verdicts on all actions."""
    mask: ActionMask = (verdicts.executed == NUMBERS).astype(np.int8)
    return mask


NUMBERS = np.arange(len(ACTIONS))
