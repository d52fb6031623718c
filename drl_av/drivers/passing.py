"""Keeps a driver of the ego from passing on the right, which SUMO's drivers do not do (ours)."""

import numpy as np
import numpy.typing as npt

from drl_av.config import EgoConfig
from drl_av.config.traffic import CONGESTED_M_S
from drl_av.drivers.driver import Driver
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.affordances import Neighbor
from drl_av.driving.scene import Scene


class NoPassingOnTheRight:
    """Wraps a driver so that it does not pass vehicles on their right side.

    The driver stays behind the vehicle ahead in the left lane as if that vehicle were in its own
    lane. It changes to the right only if it may pass the vehicle ahead in its own lane. It may pass
    a vehicle that is beside the ego (gap 0) or not faster than 60 km/h.
    """

    def __init__(self, driver: Driver, ego: EgoConfig) -> None:
        self._driver, self._ego = driver, ego

    def start(self, seed: int) -> None:
        """Prepare the inner driver for an episode."""
        self._driver.start(seed)

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the inner driver's action, changed where it would pass on the right.

        A forbidden change to the right becomes KEEP. If the ego must not pass the vehicle ahead in
        the left lane, the inner driver decides a second time, as if that vehicle were in the ego's
        lane. The ego then takes the smaller acceleration of the two decisions.
        """
        action = self._driver.act(scene, observation)
        lateral, longitudinal = action
        if lateral is Lateral.RIGHT and self._must_not_pass(scene, scene.affordances.own_front):
            lateral = Lateral.KEEP
        left = scene.affordances.left_front
        if self._must_not_pass(scene, left):
            affordances = scene.affordances._replace(own_front=left)
            behind = self._driver.act(scene._replace(affordances=affordances), observation)
            longitudinal = min(longitudinal, behind.longitudinal, key=self._acceleration_m_s2)
        return Action(lateral, longitudinal)

    def _acceleration_m_s2(self, longitudinal: Longitudinal) -> float:
        return longitudinal.acceleration_m_s2(self._ego)

    def _must_not_pass(self, scene: Scene, other: Neighbor | None) -> bool:
        if other is None or other.gap_m <= 0.0:
            return False
        return scene.affordances.ego_speed_m_s + other.relative_speed_m_s > CONGESTED_M_S
