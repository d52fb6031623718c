"""The drivers ``sumo`` and ``sumo-tuned``: SUMO itself drives the ego."""

import numpy as np
import numpy.typing as npt

from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.traffic.ego_model import EgoModel

TUNED = EgoModel(headway_s=0.8, assertiveness=1.5, speed_gain=5.0, overtake_right=True)
"""The fastest parameters of a search outside the project (ours); ``EgoModel()`` is SUMO's own."""


class SumoDriver:
    """A driver that lets SUMO's IDM and SL2015 drive the ego with the parameters ``model``.

    The rollout calls ``HighwayEnv.hand_over``, and the environment then ignores the actions.
    """

    def __init__(self, model: EgoModel) -> None:
        self.model = model

    def start(self, seed: int) -> None:
        """Stateless and deterministic."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Maintain and keep lane, which SUMO ignores."""
        return Action(Lateral.KEEP, Longitudinal.MAINTAIN)
