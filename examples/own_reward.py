"""A reward of your own: the paper's, less a price for each lane change and each hard brake.

python examples/own_reward.py
"""

import gymnasium

import drl_av
from drl_av.driving.actions import Longitudinal
from drl_av.env.transition import Transition

LANE_CHANGE, HARD_BRAKE = 0.2, 0.5


def comfort(transition: Transition) -> float:
    """Return the reward of one decision."""
    begun = transition.scene.lane_change is None and transition.next_scene.lane_change is not None
    braked = transition.executed.longitudinal is Longitudinal.HARD_BRAKE
    return transition.reward - LANE_CHANGE * begun - HARD_BRAKE * braked


def main() -> None:
    """Compare two drivers in one episode by the paper's reward and by this one."""
    env = gymnasium.make("drl_av/Highway-v0", reward=comfort)
    for name in ("pretrained", "idm-mobil"):
        driver = drl_av.load_driver(name)
        observation, _ = env.reset(seed=800_000, options={"vehicles": 20})
        driver.start(800_000)
        paper, own, over = 0.0, 0.0, False
        while not over:
            action = driver.act(env.unwrapped.scene, observation)
            observation, reward, terminated, truncated, info = env.step(action.number)
            paper += sum(info["rewards"].values()) / 3
            own += float(reward)
            over = terminated or truncated
        print(f"{name}: {paper:.1f} by the paper's reward, {own:.1f} by this one")
    env.close()


if __name__ == "__main__":
    main()
