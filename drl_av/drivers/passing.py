"""The ban of passing on the right, which SUMO's drivers obey, for drivers of the ego (ours)."""

import numpy as np
import numpy.typing as npt

from drl_av.config import EgoConfig
from drl_av.drivers.driver import Driver
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.affordances import Neighbor
from drl_av.driving.scene import Scene

CONGESTED_M_S = 60 / 3.6
"""Up to this speed of the vehicle that is passed the ban does not hold, as in SUMO."""


class NoPassingOnTheRight:
    """A driver that stays behind vehicles on the lane at its left as behind those in its own.

    Neither does it change to the right of a vehicle that it would pass there. Vehicles alongside
    bind it no more: it is past them, or they pass it.
    """

    def __init__(self, driver: Driver, ego: EgoConfig) -> None:
        self._driver, self._ego = driver, ego

    def start(self, seed: int) -> None:
        """Get the driver ready for an episode."""
        self._driver.start(seed)

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The driver's action, or what it would do behind the vehicle at the left if it is less."""
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
