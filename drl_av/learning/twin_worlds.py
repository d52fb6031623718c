"""The worlds of a training at scale: episodes in the twin, seen wide, and paid for speed (ours)."""

from itertools import product

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

from drl_av.compiled import compiled
from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, HARD_BRAKE, SIGNS
from drl_av.driving.wide_observation import WIDE_SIZE, wide_observation
from drl_av.env.twin_episodes import Episodes, Task
from drl_av.env.vector import TwinVectorEnv
from drl_av.learning.ppo import Outcome
from drl_av.twin.worlds import COUNT, IntArray

Float32Array = npt.NDArray[np.float32]
SIDES = np.array(SIGNS)


@compiled
def look_wide(
    episodes: Episodes,
    task: Task,
    rows: IntArray,
    count: IntArray,
    observation: Float32Array,
    permitted: npt.NDArray[np.bool_],
) -> None:
    """Write the wide observation and the mask of the worlds ``rows``, and what is permitted.

    ``count``, shape (worlds,), holds the numbers of vehicles, the ego included. ``observation`` has
    the shape (worlds, WIDE_SIZE + 12); the mask is at its end. If no action is permitted,
    ``permitted``, shape (worlds, 12), is True for all.
    """
    for w in rows:
        n, scene = count[w], episodes.scene[w]
        wide_observation(
            scene[0, :n],
            scene[1, :n],
            scene[2, :n],
            scene[3, :n],
            scene[4, :n],
            scene[5, :n],
            task.road,
            task.range_m,
            task.ego.max_speed_m_s,
            episodes.lanes[w, 0],
            episodes.lanes[w, 1],
            observation[w, :WIDE_SIZE],
        )
        some = False
        for action in range(12):
            is_permitted = episodes.executed[w, action] == action
            permitted[w, action] = is_permitted
            observation[w, WIDE_SIZE + action] = 1.0 if is_permitted else 0.0
            some = some or is_permitted
        if not some:
            permitted[w, :] = True


class TwinWorlds:
    """W worlds in the twin; ``ppo.ManyWorlds`` describes the interface.

    They are divided by the safety check, ``paper`` or ``strict``, and by the traffic, that of the
    config or ``overtaking``. Their episodes begin at different times.

    Raises:
        ConfigError: the twin cannot do what the settings ask.
    """

    def __init__(self, config: Config, seed: int) -> None:
        self._settings, count = config.ppo, config.ppo.worlds
        self.observation = np.zeros((count, WIDE_SIZE + len(ACTIONS)), np.float32)
        self.permitted = np.zeros((count, len(ACTIONS)), np.bool_)
        paper, overtaking = config.ppo.paper_share, config.ppo.overtaking_share
        shares = product((1 - paper, paper), (1 - overtaking, overtaking))
        ends = np.rint(np.cumsum([0.0, *(one * other for one, other in shares)]) * count)
        kinds = product(("strict", "paper"), (config, config.with_traffic("overtaking")))
        self.parts: list[tuple[slice, TwinVectorEnv]] = []
        """The worlds of each environment, and the environment."""
        for first, last, (check, kind) in zip(ends[:-1], ends[1:], kinds, strict=True):
            if last > first:
                env = TwinVectorEnv(
                    int(last - first),
                    safety_check=check,
                    config=kind,
                    autoreset_mode=AutoresetMode.DISABLED,
                )
                env.reset(seed=seed + int(first))
                self.parts.append((slice(int(first), int(last)), env))
        self._begin_at_different_times(np.random.default_rng(seed))

    def _begin_at_different_times(self, rng: np.random.Generator) -> None:
        """Drive at constant speeds for an episode, and let each world begin anew at random."""
        for rows, env in self.parts:
            most = env.config.simulation.decisions_per_episode
            begins = rng.integers(0, most, env.num_envs)
            for decision in range(most):
                _, _, collided, late, _ = env.step(np.zeros(env.num_envs, np.int64))
                begin_anew(env, collided | late | (begins == decision))
            self._look(rows, env, np.arange(env.num_envs))

    def _look(self, rows: slice, env: TwinVectorEnv, worlds: IntArray) -> None:
        """Update the observations and the masks of some worlds of one environment."""
        count = env.worlds.near[:, COUNT].copy()
        look_wide(
            env.episodes, env.task, worlds, count, self.observation[rows], self.permitted[rows]
        )

    def step(self, action: npt.NDArray[np.int64]) -> Outcome:
        """Execute one action in each world, shape (W,)."""
        parts = [self._step(rows, env, action[rows]) for rows, env in self.parts]
        return Outcome(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))

    def _step(self, rows: slice, env: TwinVectorEnv, action: npt.NDArray[np.int64]) -> Outcome:
        """Execute one action in each world of one environment."""
        settings, (origin, target) = self._settings, env.episodes.lanes.T.copy()
        _, _, terminated, truncated, info = env.step(action)
        executed, speed = info["executed_action"], info["speed_m_s"]
        aborts = (origin != target) & (SIDES[executed // 4] == origin - target)
        reward = (speed - settings.middle_speed_m_s) / settings.speed_scale_m_s
        reward -= settings.abort_cost * aborts
        reward -= settings.hard_brake_cost * (executed % 4 == HARD_BRAKE)
        reward -= settings.collision_cost * terminated
        self._look(rows, env, np.arange(env.num_envs))
        truncated &= ~terminated
        final, over = self.observation[rows][truncated], terminated | truncated
        if over.any():
            begin_anew(env, over)
            self._look(rows, env, np.flatnonzero(over))
        return Outcome(reward.astype(np.float32), terminated, truncated, final)


def begin_anew(env: TwinVectorEnv, worlds: npt.NDArray[np.bool_]) -> None:
    """Begin a new episode in some worlds, bool of shape (worlds,)."""
    if worlds.any():
        env.reset(options={"reset_mask": worlds})
