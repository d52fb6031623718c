"""torchrl: a DQN among many highways at once, in the compiled twin of SUMO's traffic.

python examples/torchrl_dqn.py [DECISIONS [WORLDS]]
"""

import sys

import gymnasium
import torch
from tensordict.nn import TensorDictSequential
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs.libs.gym import GymWrapper
from torchrl.modules import MLP, EGreedyModule, QValueActor
from torchrl.objectives import DQNLoss, SoftUpdate

import drl_av  # registers the environment

ID = "drl_av/Highway-v0"


def main(decisions: int = 200_000, worlds: int = 64) -> None:
    """Train, and print the mean reward of a decision on the way."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    envs = gymnasium.make_vec(ID, worlds, "vector_entry_point", autoreset_mode="Disabled")
    env = GymWrapper(envs, categorical_action_encoding=True)
    env.set_seed(1)
    spec = env.action_spec_unbatched
    q = QValueActor(MLP(in_features=27, out_features=spec.n, num_cells=[100, 100]), spec=spec)
    explore = EGreedyModule(spec, annealing_num_steps=decisions // 2, eps_end=0.05)
    policy = TensorDictSequential(q, explore)
    batch = 8 * worlds
    collector = Collector(env, policy, frames_per_batch=batch, total_frames=decisions)
    storage = LazyTensorStorage(100_000)
    buffer = TensorDictReplayBuffer(storage=storage, batch_size=128)
    loss = DQNLoss(q, action_space=spec, delay_value=True)
    loss.make_value_estimator(gamma=0.93)
    target = SoftUpdate(loss, eps=0.99)
    optimizer = torch.optim.Adam(loss.parameters(), lr=1e-3)
    for number, collected in enumerate(collector, start=1):
        explore.step(batch)
        buffer.extend(collected.reshape(-1))
        for _ in range(batch // 16):
            optimizer.zero_grad()
            loss(buffer.sample())["loss"].backward()
            optimizer.step()
            target.step()
        reward = collected["next", "reward"].mean()
        print(f"{number * batch} decisions: mean reward {reward:.3f}")
    collector.shutdown()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
