"""A driver of your own: keep a time gap, and overtake on the left where there is room.

python examples/own_driver.py
"""

import numpy as np
import numpy.typing as npt

from drl_av.cli import main as run_command
from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.affordances import Affordances
from drl_av.driving.scene import Scene


class TimeGapDriver:
    """Follows at a time gap; changes to the left if it has caught up with the vehicle ahead."""

    def __init__(self, headway_s: float = 1.5) -> None:
        self.headway_s = headway_s

    def start(self, seed: int) -> None:
        """Do nothing: the driver has no state and draws no random numbers."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return an action for the scene; the safety check examines it afterwards."""
        return Action(self.lateral(scene.affordances), self.longitudinal(scene.affordances))

    def longitudinal(self, affordances: Affordances) -> Longitudinal:
        """Accelerate if there is much room ahead, brake if there is too little."""
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


def time_gap(config: Config) -> TimeGapDriver:
    """Return the driver for a config; --driver own_driver:time_gap names this function."""
    return TimeGapDriver()


def main() -> None:
    """Compare the driver with idm-mobil in the same traffic, by the command drl-av evaluate."""
    where = ["--vehicles", "15", "--episodes", "3", "--seed", "800000"]
    run_command(["evaluate", "--driver", "own_driver:time_gap", "idm-mobil", *where])


if __name__ == "__main__":
    main()
