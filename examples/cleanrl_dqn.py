"""A DQN in one file, in the manner of CleanRL, with an evaluation midway.

python examples/cleanrl_dqn.py [STEPS]
"""

import random
import sys
from dataclasses import dataclass

import gymnasium
import numpy as np
import torch
from torch import nn

import drl_av  # registers the environment


@dataclass
class Args:
    """The settings of the training."""

    env_id: str = "drl_av/Highway-v0"
    seed: int = 1
    total_steps: int = 20_000
    learning_rate: float = 1e-3
    buffer_size: int = 20_000
    gamma: float = 0.93
    batch_size: int = 128
    learning_starts: int = 200
    train_every: int = 4
    target_every: int = 500
    epsilon_end: float = 0.05
    exploration_fraction: float = 0.3


def network(env: gymnasium.vector.VectorEnv) -> nn.Sequential:
    """Return the Q-network: from observations, shape (rows, 27), to Q-values, shape (rows, 12)."""
    size, actions = env.single_observation_space.shape[0], env.single_action_space.n
    return nn.Sequential(
        nn.Linear(size, 100), nn.ReLU(), nn.Linear(100, 100), nn.ReLU(), nn.Linear(100, actions)
    )


def evaluate(args: Args, q: nn.Module, episodes: int = 1) -> float:
    """Compute the mean return of greedy episodes in a separate environment."""
    env, returns = gymnasium.make(args.env_id), []
    for episode in range(episodes):
        observation, _ = env.reset(seed=900_000 + episode)
        total, over = 0.0, False
        while not over:
            with torch.no_grad():
                action = int(q(torch.as_tensor(observation)).argmax())
            observation, reward, terminated, truncated, _ = env.step(action)
            total, over = total + float(reward), terminated or truncated
        returns.append(total)
    env.close()
    return float(np.mean(returns))


def main(steps: int = Args.total_steps) -> None:
    """Train, and evaluate midway and at the end."""
    args = Args(total_steps=steps)
    random.seed(args.seed)
    np.random.seed(args.seed)
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)
    mode = gymnasium.vector.AutoresetMode.SAME_STEP
    envs = gymnasium.make_vec(args.env_id, 1, "sync", vector_kwargs={"autoreset_mode": mode})
    envs = gymnasium.wrappers.vector.RecordEpisodeStatistics(envs)
    q, target = network(envs), network(envs)
    target.load_state_dict(q.state_dict())
    optimizer = torch.optim.Adam(q.parameters(), lr=args.learning_rate)
    shape = (args.buffer_size, envs.single_observation_space.shape[0])
    s_t, s_tp1 = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    a_t = np.zeros(args.buffer_size, np.int64)
    r_tp1, ended = np.zeros((2, args.buffer_size), np.float32)

    observations, _ = envs.reset(seed=args.seed)
    for step in range(args.total_steps):
        progress = step / (args.exploration_fraction * args.total_steps)
        if random.random() < max(args.epsilon_end, 1 - progress):
            actions = envs.action_space.sample()
        else:
            with torch.no_grad():
                actions = q(torch.as_tensor(observations)).argmax(1).numpy()
        following, rewards, terminated, _, infos = envs.step(actions)
        last = infos["final_obs"][0] if "final_obs" in infos else following[0]
        row = step % args.buffer_size
        s_t[row], a_t[row], r_tp1[row] = observations[0], actions[0], rewards[0]
        s_tp1[row], ended[row] = last, terminated[0]
        observations = following
        if "episode" in infos:
            print(f"step {step + 1}: return {infos['episode']['r'][0]:.1f}")

        if step >= args.learning_starts and step % args.train_every == 0:
            rows = np.random.randint(min(step + 1, args.buffer_size), size=args.batch_size)
            with torch.no_grad():
                following_value = target(torch.as_tensor(s_tp1[rows])).max(1).values
                goal = torch.as_tensor(r_tp1[rows])
                goal += args.gamma * following_value * torch.as_tensor(1 - ended[rows])
            value = q(torch.as_tensor(s_t[rows])).gather(1, torch.as_tensor(a_t[rows])[:, None])
            loss = nn.functional.mse_loss(value[:, 0], goal)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        if step % args.target_every == 0:
            target.load_state_dict(q.state_dict())
        if step + 1 in (args.total_steps // 2, args.total_steps):
            print(f"step {step + 1}: greedy return {evaluate(args, q):.1f}")
    envs.close()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
