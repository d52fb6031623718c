"""Drivers made of other things: a driver under a safety check, and any function."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from drl_av.drivers.driver import Driver
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene
from drl_av.safety.check import Rule, SafetyCheck, Verdict


class CheckedDriver:
    """A driver under a safety check, for an environment that has none (``permit_all``).

    It drives as the bare driver does in an environment with that check.
    """

    def __init__(self, driver: Driver, check: SafetyCheck) -> None:
        self._driver, self._check = driver, check
        self.verdict: Verdict | None = None
        """On the last proposal; None before the first."""
        self.triggers = 0
        """Proposals of this episode that the check changed."""

    def start(self, seed: int) -> None:
        """Get the driver ready for an episode."""
        self.verdict, self.triggers = None, 0
        self._driver.start(seed)

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The driver's proposal where the check permits it, else the check's replacement."""
        self.verdict = self._check(scene, self._driver.act(scene, observation))
        self.triggers += self.verdict.rule is not Rule.NONE
        return self.verdict.action


class PolicyDriver:
    """Any function from an observation to an action's number, as a driver.

    For instance ``lambda o: model.predict(o, deterministic=True)[0]`` of stable-baselines3.
    """

    def __init__(self, policy: Callable[[npt.NDArray[np.float32]], int | np.integer]) -> None:
        self._policy = policy

    def start(self, seed: int) -> None:
        """Nothing to prepare: any randomness is the function's own."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The function's action."""
        return ACTIONS[int(self._policy(observation))]
