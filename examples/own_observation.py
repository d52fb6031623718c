"""Observations of your own: groups of indicators, and a function of the scene.

python examples/own_observation.py
"""

import gymnasium
import numpy as np
import numpy.typing as npt

import drl_av
from drl_av.drivers.checked import PolicyDriver
from drl_av.driving.scene import Scene

GROUPS = ("own_front", "right_front", "left_front", "ego", "lanes", "lane_change")
"""The vehicles ahead in three lanes, the ego's state, the lanes beside it, and its lane change."""

MAINTAIN, ACCELERATE, BRAKE = 0, 1, 2


class TimeGaps:
    """The time gaps to the vehicles ahead in the own, right and left lane, 10 s at most."""

    space = gymnasium.spaces.Box(0, 10, shape=(3,), dtype=np.float32)

    def __call__(self, scene: Scene) -> npt.NDArray[np.float32]:
        """Return the observation of a scene, shape (3,), s."""
        affordances = scene.affordances
        speed_m_s = max(affordances.ego_speed_m_s, 0.1)
        ahead = [affordances.front(sign) for sign in (0, -1, 1)]
        gaps_s = [10.0 if front is None else front.gap_m / speed_m_s for front in ahead]
        return np.minimum(gaps_s, 10.0).astype(np.float32)


def policy(gaps_s: npt.NDArray[np.float32]) -> int:
    """Return the action number that keeps a time gap of about 1.5 s in the ego's lane."""
    if gaps_s[0] < 1.2:
        return BRAKE
    return ACCELERATE if gaps_s[0] > 1.8 else MAINTAIN


def main() -> None:
    """Observe in both ways, and compare the policy with the driver that ships with drl-av."""
    for observation in (GROUPS, TimeGaps()):
        env = gymnasium.make("drl_av/Highway-v0", observation=observation)
        observed, _ = env.reset(seed=800_000, options={"vehicles": 20})
        print(f"{env.observation_space.shape}: {np.round(observed[:4], 2)}")
        env.close()
    own = {"time gaps": PolicyDriver(policy, TimeGaps())}
    for row in drl_av.evaluate("pretrained", own=own, vehicles=20, episodes=2, seed=800_000):
        print(f"{row.driver}, seed {row.seed}: {row.mean_speed_m_s:.1f} m/s")


if __name__ == "__main__":
    main()
