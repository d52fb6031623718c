"""``sumo`` and ``sumo-tuned``: the ego handed over to SUMO entirely."""

import numpy as np
import numpy.typing as npt

from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.traffic.ego_model import EgoModel

TUNED = EgoModel(headway_s=0.8, assertiveness=1.5, speed_gain=5.0, overtake_right=True)
"""The fastest of what was tried outside the project (ours); SUMO's own is ``EgoModel()``."""


class SumoDriver:
    """Has SUMO's own IDM and SL2015 drive the ego by a model.

    A rollout hands the ego over to it (``HighwayEnv.hand_over``); its actions are not asked for.
    """

    def __init__(self, model: EgoModel) -> None:
        self.model = model

    def start(self, seed: int) -> None:
        """Stateless and deterministic."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Maintain and keep lane, which SUMO ignores."""
        return Action(Lateral.KEEP, Longitudinal.MAINTAIN)
