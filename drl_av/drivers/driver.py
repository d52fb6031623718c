"""The interface of a driver, of the ego and of the traffic."""

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from drl_av.driving.actions import Action
from drl_av.driving.scene import Scene
from drl_av.traffic.road import FloatArray


class Driver(Protocol):
    """Chooses an action for each scene; the safety check examines it afterwards."""

    def start(self, seed: int) -> None:
        """Prepare for an episode; all randomness of the driver must come from ``seed``."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The action for a scene, whose scaled observation has shape (27,)."""


class Decisions(NamedTuple):
    """The decisions of R vehicles of the traffic, in force until their next ones."""

    acceleration_m_s2: FloatArray
    side: npt.NDArray[np.intp]
    """A lane change to the left (+1) or right (-1), or none (0)."""
