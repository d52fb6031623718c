"""sb3-contrib: a MaskablePPO that chooses among the actions that the safety check permits.

python examples/maskable_ppo.py [STEPS]
"""

import sys

import gymnasium
from sb3_contrib import MaskablePPO
from stable_baselines3.common.env_util import make_vec_env

import drl_av  # registers the environment

ID = "drl_av/Highway-v0"


def main(steps: int = 20_000) -> None:
    """Train; then drive one episode and count the actions that the check changed."""
    training = make_vec_env(ID, n_envs=2, seed=0)
    batch = {"n_steps": min(256, steps // 2), "batch_size": min(256, steps)}
    model = MaskablePPO("MlpPolicy", training, gamma=0.93, seed=0, device="cpu", **batch)
    model.learn(steps)
    model.save("maskable_ppo.zip")
    training.close()
    env = gymnasium.make(ID)
    observation, info = env.reset(seed=800_000, options={"vehicles": 20})
    changed, over = 0, False
    while not over:
        action, _ = model.predict(observation, action_masks=info["action_mask"], deterministic=True)
        observation, _, terminated, truncated, info = env.step(action)
        changed += info["rule"] != "none"
        over = terminated or truncated
    env.close()
    print(f"{changed} actions changed, collision: {info['collision'] or 'none'}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
