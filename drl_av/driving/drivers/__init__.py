"""Drivers: anything that picks an action."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from drl_av.driving.actions import Action
from drl_av.driving.maneuver import Scene


class Driver(Protocol):
    """Picks a decision from a scene; the safety check judges it afterwards."""

    def start(self, seed: int) -> None:
        """Get ready for an episode; all randomness of the driver comes from ``seed``."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The decision for a scene, also given as the scaled observation, shape (27,)."""
