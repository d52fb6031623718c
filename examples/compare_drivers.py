"""Compare a driver of your own with others in the same traffic, with confidence intervals.

python examples/compare_drivers.py [EPISODES]
"""

import sys

import numpy as np
import numpy.typing as npt

import drl_av
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.evaluation.statistics import paired, summarize

OTHERS = ("pretrained", "idm-mobil")


class FullThrottle:
    """Accelerates always and leaves the braking to the safety check."""

    def start(self, seed: int) -> None:
        """Do nothing: the driver has no state and draws no random numbers."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Keep the lane and accelerate."""
        return Action(Lateral.KEEP, Longitudinal.ACCELERATE)


def main(episodes: int = 20) -> None:
    """Print the means of each driver, and the gain of FullThrottle over the others."""
    rows = drl_av.evaluate(
        OTHERS, own={"mine": FullThrottle()}, vehicles=[5, 20], episodes=episodes, seed=800_000
    )
    for summary in summarize(rows):
        print(
            f"{summary.vehicles} vehicles, {summary.driver}: {summary.speed_m_s} m/s, "
            f"hit something in {summary.ego_hits} of {summary.episodes} episodes"
        )
    for gain in paired(rows, "mine", OTHERS):
        print(f"{gain.vehicles} vehicles: {gain.difference_m_s} m/s over {gain.baseline}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
