"""sb3-contrib: a MaskablePPO that chooses among the actions that the safety check permits.

python examples/maskable_ppo.py [STEPS [WORLDS]]

With WORLDS, it trains in so many worlds of the compiled twin at once, in place of SUMO.
"""

import sys
from typing import Any

import gymnasium
import numpy as np
from sb3_contrib import MaskablePPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv

import drl_av  # registers the environment

ID = "drl_av/Highway-v0"


class TwinVecEnv(VecEnv):
    """Worlds of the twin, as stable-baselines3 wants them."""

    def __init__(self, worlds: int) -> None:
        mode = gymnasium.vector.AutoresetMode.SAME_STEP
        self.envs = gymnasium.make_vec(ID, worlds, "vector_entry_point", autoreset_mode=mode)
        spaces = self.envs.single_observation_space, self.envs.single_action_space
        super().__init__(worlds, *spaces)

    def reset(self) -> np.ndarray:
        return self.envs.reset(seed=0)[0]

    def step_async(self, actions: np.ndarray) -> None:
        self.actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        observations, rewards, terminated, truncated, info = self.envs.step(self.actions)
        infos: list[dict[str, Any]] = [{} for _ in rewards]
        for row in np.flatnonzero(terminated | truncated):
            late = {"TimeLimit.truncated": not terminated[row]}
            infos[row] = {"terminal_observation": info["final_obs"][row]} | late
        return observations, rewards.astype(np.float32), terminated | truncated, infos

    def env_method(self, name: str, *args: Any, **kwargs: Any) -> list[Any]:
        return [*getattr(self.envs.unwrapped, name)(*args)]

    def has_attr(self, name: str) -> bool:
        return hasattr(self.envs.unwrapped, name)

    def get_attr(self, name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.envs.unwrapped, name)] * self.num_envs

    def set_attr(self, name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs

    def close(self) -> None:
        self.envs.close()


def main(steps: int = 20_000, worlds: int = 0) -> None:
    """Train; then drive one episode in SUMO and count the actions that the check changed."""
    training = TwinVecEnv(worlds) if worlds else make_vec_env(ID, n_envs=2, seed=0)
    batch = {"n_steps": min(256, steps // training.num_envs), "batch_size": min(256, steps)}
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
