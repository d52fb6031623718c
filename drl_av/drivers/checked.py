"""Two wrappers: one adds a safety check to a driver, the other makes a function a driver."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from drl_av.config.functions import require_function
from drl_av.drivers.driver import Driver
from drl_av.drivers.rule_based import SumoDriver
from drl_av.driving.actions import Action, action_of
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.safety.check import Rule, SafetyCheck, Verdict, apply_check


class CheckedDriver:
    """A driver with its own safety check, which examines the actions of an inner driver.

    In an environment with the safety check ``permit_all``, it drives exactly as the inner driver
    does in an environment with this check.

    Raises:
        ConfigError: ``driver`` is ``sumo`` or ``sumo-tuned``, which propose no actions.
    """

    def __init__(self, driver: Driver, check: SafetyCheck) -> None:
        if isinstance(driver, SumoDriver):
            raise ConfigError(
                "SUMO itself drives the ego with this driver, so a check has no actions to "
                "examine: wrap another driver."
            )
        self._driver, self._check = driver, check
        self.verdict: Verdict | None = None
        """The verdict on the last proposal; None before the first one."""
        self.triggers = 0
        """Number of proposals since ``start`` that the check changed."""

    def start(self, seed: int) -> None:
        """Prepare for an episode: set ``triggers`` to 0, and start the inner driver."""
        self.verdict, self.triggers = None, 0
        self._driver.start(seed)

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the inner driver's proposal, or the action by which the check replaces it."""
        self.verdict = apply_check(self._check, scene, self._driver.act(scene, observation))
        self.triggers += self.verdict.rule is not Rule.NONE
        return self.verdict.action


class PolicyDriver(Driver):
    """A driver whose action is the number that a function of the observation returns.

    With stable-baselines3 pass ``lambda o: model.predict(o, deterministic=True)[0]``.

    Args:
        policy: The function from an observation to an action number, or to an array of one such
            number.
        observe: The function from a scene to the observation, for a policy that was trained with
            another observation. If it is None, the policy gets the 27 scaled indicators.

    Raises:
        ConfigError: ``policy`` or ``observe`` is not a function of one argument.
    """

    def __init__(
        self,
        policy: Callable[[Any], int | np.integer | npt.NDArray[Any]],
        observe: Callable[[Scene], Any] | None = None,
    ) -> None:
        require_function(policy, "policy", "observation")
        if observe is not None:
            require_function(observe, "observe", "scene")
        self._policy, self._observe = policy, observe

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Call the function with the observation, and return the action with the returned number.

        Raises:
            ConfigError: the function returns anything but an integer from 0 to 11.
        """
        observed = observation if self._observe is None else self._observe(scene)
        return action_of(self._policy(observed))
