"""The drivers ``sumo`` and ``sumo-tuned``: SUMO itself drives the ego."""

import numpy as np
import numpy.typing as npt

from drl_av.drivers.driver import Driver
from drl_av.driving.actions import Action
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.simulation.vehicle_calls import EgoModel

TUNED = EgoModel(headway_s=0.8, assertiveness=1.5, speed_gain=5.0, overtake_right=True)
"""The parameters of ``sumo-tuned`` (ours): those with the highest speed in a search. The search is
not part of this project."""


class SumoDriver(Driver):
    """Lets SUMO's IDM and lane-change model SL2015 drive the ego, with the parameters ``model``.

    For this driver ``rollout`` calls ``HighwayEnv.hand_over`` instead of ``act``; the environment
    then ignores actions.
    """

    def __init__(self, model: EgoModel) -> None:
        self.model = model

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Raise ConfigError: SUMO chooses no action."""
        raise ConfigError(
            "SUMO itself drives the ego with this driver, which therefore has no actions: give "
            "its name to drl_av.evaluate, or call env.unwrapped.hand_over(driver.model) after each "
            "reset and pass any action to step."
        )
