"""RLlib: PPO with two remote runners of two environments each.

RLlib needs another version of gymnasium than the other libraries, so it has its own Python
environment; `make rllib` installs it and runs this program.

python examples/rllib_ppo.py [ITERATIONS]
"""

import sys

import ray
from ray.rllib.algorithms.ppo import PPOConfig

ID = "drl_av:drl_av/Highway-v0"
"""With the module, so that each runner imports drl_av, which registers the environment."""


def main(iterations: int = 20) -> None:
    """Train, and print the mean return and length of the episodes after each iteration."""
    ray.init(num_cpus=3, include_dashboard=False, log_to_driver=False)
    config = (
        PPOConfig()
        .environment(ID)
        .env_runners(num_env_runners=2, num_envs_per_env_runner=2)
        .training(gamma=0.93, train_batch_size=800, minibatch_size=200, num_epochs=4)
        .debugging(seed=0)
    )
    algorithm = config.build_algo()
    for iteration in range(1, iterations + 1):
        found = algorithm.train()["env_runners"]
        print(
            f"iteration {iteration}: {found['num_env_steps_sampled_lifetime']:.0f} decisions, "
            f"return {found['episode_return_mean']:.1f}, length {found['episode_len_mean']:.0f}"
        )
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
