"""One episode of random actions, each examined by the safety check."""

import gymnasium

import drl_av  # registers the environment

env = gymnasium.make("drl_av/Highway-v0", safety_check="paper")
env.action_space.seed(7)
observation, info = env.reset(seed=7, options={"vehicles": 30})
replaced, over = 0, False
while not over:
    action = env.action_space.sample()
    observation, reward, terminated, truncated, info = env.step(action)
    replaced += info["rule"] != "none"
    over = terminated or truncated
print(f"{replaced} actions replaced, collision: {info['collision'] or 'none'}")
env.close()
