"""Wrappers that make drivers: a driver with its own safety check, and a policy function."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from drl_av.drivers.driver import Driver
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene
from drl_av.safety.check import Rule, SafetyCheck, Verdict


class CheckedDriver:
    """A driver with its own safety check, for an environment without one (``permit_all``).

    The result is the same as with the bare driver in an environment with that check.
    """

    def __init__(self, driver: Driver, check: SafetyCheck) -> None:
        self._driver, self._check = driver, check
        self.verdict: Verdict | None = None
        """The verdict on the last proposal; None before the first one."""
        self.triggers = 0
        """Number of proposals in this episode that the check changed."""

    def start(self, seed: int) -> None:
        """Get the driver ready for an episode."""
        self.verdict, self.triggers = None, 0
        self._driver.start(seed)

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The driver's proposal, or the action by which the check replaces it."""
        self.verdict = self._check(scene, self._driver.act(scene, observation))
        self.triggers += self.verdict.rule is not Rule.NONE
        return self.verdict.action


class PolicyDriver:
    """A driver made of a function from an observation to an action number.

    An example is ``lambda o: model.predict(o, deterministic=True)[0]`` with stable-baselines3.

    Args:
        policy: The function from an observation to an action number.
        observe: The function from a scene to the observation, for a policy that was trained with an
            observation of its own; without it the policy takes the 27 scaled indicators.
    """

    def __init__(
        self,
        policy: Callable[[Any], int | np.integer],
        observe: Callable[[Scene], Any] | None = None,
    ) -> None:
        self._policy, self._observe = policy, observe

    def start(self, seed: int) -> None:
        """Do nothing; the function itself must handle any randomness."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The action that the function returns."""
        observed = observation if self._observe is None else self._observe(scene)
        return ACTIONS[int(self._policy(observed))]
