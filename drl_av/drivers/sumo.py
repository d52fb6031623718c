"""The drivers ``sumo`` and ``sumo-tuned``: SUMO itself drives the ego."""

import numpy as np
import numpy.typing as npt

from drl_av.drivers.driver import Driver
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.traffic.ego_model import EgoModel

TUNED = EgoModel(headway_s=0.8, assertiveness=1.5, speed_gain=5.0, overtake_right=True)
"""The parameters of ``sumo-tuned`` (ours): those with the highest speed in a search. The search is
not part of this project."""


class SumoDriver(Driver):
    """Lets SUMO's IDM and lane-change model SL2015 drive the ego, with the parameters ``model``.

    For this driver ``rollout`` calls ``HighwayEnv.hand_over``; the environment then ignores the
    driver's actions.
    """

    def __init__(self, model: EgoModel) -> None:
        self.model = model

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return a placeholder, maintain and keep lane, which the environment ignores."""
        return Action(Lateral.KEEP, Longitudinal.MAINTAIN)
