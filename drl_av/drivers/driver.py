"""The interface of the drivers of the ego."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from drl_av.driving.actions import Action
from drl_av.driving.scene import Scene


class Driver(Protocol):
    """Proposes one action for each decision of the ego; the safety check examines this action."""

    def start(self, seed: int) -> None:
        """Prepare for a new episode; by default do nothing.

        A driver that needs random numbers draws them from a generator with this seed.
        """
        return None

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the action to propose in this scene.

        ``observation`` is the environment's observation of this scene. By default it holds the 27
        affordance indicators, scaled to about [-1, 1].
        """
