"""Drivers: anything that picks an action."""

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from drl_av.driving.actions import Action
from drl_av.driving.scene import Scene
from drl_av.traffic.road import FloatArray


class Driver(Protocol):
    """Picks a decision from a scene; the safety check judges it afterwards."""

    def start(self, seed: int) -> None:
        """Get ready for an episode; all randomness of the driver comes from ``seed``."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The decision for a scene, also given as the scaled observation, shape (27,)."""


class Decisions(NamedTuple):
    """What each of R vehicles of the traffic wants until its next decision."""

    acceleration_m_s2: FloatArray
    side: npt.NDArray[np.intp]
    """A lane change to the left (+1) or right (-1), or none (0)."""
