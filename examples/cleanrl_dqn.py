"""A DQN in one file, in the manner of CleanRL, with an evaluation midway.

python examples/cleanrl_dqn.py [STEPS [WORLDS]]

With WORLDS, it trains in so many worlds of the compiled twin at once, in place of SUMO.
"""

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
    twin_worlds: int = 0
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


def make_envs(args: Args) -> gymnasium.vector.VectorEnv:
    """Return the environments of the training: one in SUMO, or many in the twin."""
    mode = gymnasium.vector.AutoresetMode.SAME_STEP
    if args.twin_worlds:
        many = args.env_id, args.twin_worlds, "vector_entry_point"
        envs = gymnasium.make_vec(*many, autoreset_mode=mode)
    else:
        envs = gymnasium.make_vec(args.env_id, 1, "sync", vector_kwargs={"autoreset_mode": mode})
    return gymnasium.wrappers.vector.RecordEpisodeStatistics(envs)


def main(steps: int = Args.total_steps, worlds: int = Args.twin_worlds) -> None:
    """Train, and evaluate midway and at the end, in SUMO."""
    args = Args(total_steps=steps, twin_worlds=worlds)
    np.random.seed(args.seed)
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)
    envs = make_envs(args)
    n = envs.num_envs
    q, target = network(envs), network(envs)
    target.load_state_dict(q.state_dict())
    optimizer = torch.optim.Adam(q.parameters(), lr=args.learning_rate)
    shape = (args.buffer_size, envs.single_observation_space.shape[0])
    s_t, s_tp1 = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    a_t = np.zeros(args.buffer_size, np.int64)
    r_tp1, ended = np.zeros((2, args.buffer_size), np.float32)

    envs.action_space.seed(args.seed)
    observations, _ = envs.reset(seed=args.seed)
    for step in range(0, args.total_steps, n):
        progress = step / (args.exploration_fraction * args.total_steps)
        explores = np.random.random(n) < max(args.epsilon_end, 1 - progress)
        with torch.no_grad():
            greedy = q(torch.as_tensor(observations)).argmax(1).numpy()
        actions = np.where(explores, envs.action_space.sample(), greedy)
        following, rewards, terminated, _, infos = envs.step(actions)
        last = following.copy()
        for over in np.flatnonzero(infos.get("_final_obs", [])):
            last[over] = infos["final_obs"][over]
        row = (step + np.arange(n)) % args.buffer_size
        s_t[row], a_t[row], r_tp1[row] = observations, actions, rewards
        s_tp1[row], ended[row] = last, terminated
        observations = following
        if "episode" in infos:
            mean = infos["episode"]["r"][infos["_episode"]].mean()
            print(f"step {step + n}: return {mean:.1f}")

        updates = len(range(-step % args.train_every, n, args.train_every))
        for _ in range(updates if step >= args.learning_starts else 0):
            rows = np.random.randint(min(step + n, args.buffer_size), size=args.batch_size)
            with torch.no_grad():
                following_value = target(torch.as_tensor(s_tp1[rows])).max(1).values
                goal = torch.as_tensor(r_tp1[rows])
                goal += args.gamma * following_value * torch.as_tensor(1 - ended[rows])
            value = q(torch.as_tensor(s_t[rows])).gather(1, torch.as_tensor(a_t[rows])[:, None])
            loss = nn.functional.mse_loss(value[:, 0], goal)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        if step % args.target_every < n:
            target.load_state_dict(q.state_dict())
        if step < args.total_steps // 2 <= step + n or step + n >= args.total_steps:
            print(f"step {step + n}: greedy return {evaluate(args, q):.1f}")
    envs.close()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
