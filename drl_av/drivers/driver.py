"""The interface of a driver, which chooses the actions of the ego."""

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from drl_av.driving.actions import Action
from drl_av.driving.scene import Scene
from drl_av.traffic.road import FloatArray


class Driver(Protocol):
    """Proposes an action for each scene; the safety check examines the proposal afterwards."""

    def start(self, seed: int) -> None:
        """Prepare for an episode; all random numbers of the driver must come from ``seed``."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The proposed action in a scene; ``observation`` is the scaled scene, shape (27,)."""


class Decisions(NamedTuple):
    """The decisions of R background vehicles until their next decision; arrays of shape (R,)."""

    acceleration_m_s2: FloatArray
    side: npt.NDArray[np.intp]
    """The requested lane change: to the left (+1), to the right (-1) or none (0)."""
