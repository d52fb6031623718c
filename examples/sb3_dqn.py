"""stable-baselines3: train a DQN beside its evaluation, and compare it with the shipped driver.

python examples/sb3_dqn.py [STEPS [sumo | twin]]
"""

import sys

from stable_baselines3 import DQN
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.env_util import make_vec_env

import drl_av

ID = "drl_av/Highway-v0"
SCALARS = ("mean_speed_m_s", "ego_hit", "safety_triggers")


class LogScalars(BaseCallback):
    """Logs the scalars of the episodes that end as ``rollout/...``, beside the success rate."""

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            for name in SCALARS if "episode" in info else ():
                self.logger.record_mean(f"rollout/{name}", info["episode"][name])
        return True


def main(steps: str = "20000", world: str = "sumo") -> None:
    """Train in one of the worlds, evaluate in SUMO, save the agent, and drive it there."""
    steps, config = int(steps), {"simulation": {"world": world}}
    own = {"env_kwargs": {"config": config}, "monitor_kwargs": {"info_keywords": SCALARS}}
    training = make_vec_env(ID, seed=0, **own)
    evaluation = make_vec_env(ID, seed=1)
    callbacks = [EvalCallback(evaluation, n_eval_episodes=2, eval_freq=steps // 2), LogScalars()]
    model = DQN("MlpPolicy", training, gamma=0.93, learning_rate=1e-3, seed=0, device="cpu")
    model.learn(steps, callback=callbacks)
    model.save("sb3_dqn.zip")
    training.close()
    evaluation.close()
    drivers = ["sb3_dqn.zip@paper", "pretrained@strict"]  # each under its training's check
    for row in drl_av.evaluate(drivers, vehicles=15, episodes=2, seed=800_000):
        print(f"{row.driver}, seed {row.seed}: {row.mean_speed_m_s:.1f} m/s")


if __name__ == "__main__":
    main(*sys.argv[1:])
