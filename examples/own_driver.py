"""A driver of your own: keep a time gap, and overtake on the left where there is room.

python examples/own_driver.py
"""

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.affordances import Affordances
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive


class TimeGapDriver:
    """Follows at a time gap; changes to the left where the vehicle ahead is slow."""

    def __init__(self, headway_s: float = 1.5) -> None:
        self.headway_s = headway_s

    def start(self, seed: int) -> None:
        """Stateless and deterministic."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """An action for the scene; the safety check examines it afterwards."""
        return Action(self.lateral(scene.affordances), self.longitudinal(scene.affordances))

    def longitudinal(self, affordances: Affordances) -> Longitudinal:
        """Accelerate with room ahead, brake without."""
        front = affordances.own_front
        if front is None or front.gap_m > 2 * self.headway_s * affordances.ego_speed_m_s:
            return Longitudinal.ACCELERATE
        if front.gap_m < self.headway_s * affordances.ego_speed_m_s:
            return Longitudinal.BRAKE
        return Longitudinal.MAINTAIN

    def lateral(self, affordances: Affordances) -> Lateral:
        """Overtake on the left if the ego has caught up with the vehicle ahead."""
        behind_slow = affordances.own_front is not None and affordances.own_front.gap_m < 40
        room = affordances.left_front is None or affordances.left_front.gap_m > 60
        return Lateral.LEFT if behind_slow and affordances.left_lane and room else Lateral.KEEP


def main() -> None:
    """Compare two time gaps in the same traffic."""
    env = HighwayEnv(safety_check="strict", config=Config())
    for headway_s in (1.5, 2.5):
        result = drive(env, TimeGapDriver(headway_s), "time-gap", seed=800_000, vehicles=15)
        print(f"{headway_s} s: {result.mean_speed_m_s:.1f} m/s, collided: {result.collided}")
    env.close()


if __name__ == "__main__":
    main()
