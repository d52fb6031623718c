"""The wide observation of many worlds of the twin at once (ours)."""

import numpy as np

from drl_av.arrays import BoolArray, Float32Array, FloatArray, IntArray
from drl_av.compiled import borrowing
from drl_av.drivers.network import Layers, forward
from drl_av.driving.actions import ACTIONS
from drl_av.driving.wide_observation import WIDE_SIZE, scratch, wide_observation
from drl_av.env.twin_episodes import Episodes, Task
from drl_av.env.world_arrays import WorldArrays


@borrowing
def look_wide(
    episodes: Episodes,
    task: Task,
    rows: IntArray,
    count: IntArray,
    observation: Float32Array,
    permitted: BoolArray,
    gaps_m: FloatArray,
    found: IntArray,
) -> None:
    """Write the wide observation and the mask of the worlds ``rows``, and what is permitted.

    ``count``, shape (worlds,), holds the numbers of vehicles, the ego included. ``observation`` has
    the shape (worlds, WIDE_SIZE + 12); the mask is at its end. If no action is permitted,
    ``permitted``, shape (worlds, 12), is True for all. ``gaps_m`` and ``found`` are ``scratch``.
    """
    for w in rows:
        n, scene, lanes = count[w], episodes.scene[w], episodes.lanes[w]
        state = scene[0][:n], scene[1][:n], scene[2][:n], scene[3][:n], scene[4][:n], scene[5][:n]
        ground = task.road, task.range_m, task.ego.max_speed_m_s
        wide_observation(
            state, *ground, lanes[0], lanes[1], observation[w, :WIDE_SIZE], gaps_m, found
        )
        some = False
        for action in range(12):
            is_permitted = episodes.executed[w, action] == action
            permitted[w, action] = is_permitted
            observation[w, WIDE_SIZE + action] = 1.0 if is_permitted else 0.0
            some = some or is_permitted
        if not some:
            permitted[w, :] = True


def wide_view(worlds: WorldArrays) -> tuple[Float32Array, BoolArray]:
    """Return what ``look_wide`` fills for all worlds: the observation, and what is permitted."""
    n = worlds.num_envs
    observed = np.zeros((n, WIDE_SIZE + len(ACTIONS)), np.float32)
    permitted = np.zeros((n, len(ACTIONS)), np.bool_)
    rows, count = np.arange(n), worlds.vehicles + 1
    seen = observed, permitted, *scratch()
    look_wide.fast(worlds.episodes, worlds.task, rows, count, *seen)
    return observed, permitted


def most_probable_actions(layers: Layers, worlds: WorldArrays) -> IntArray:
    """Return the permitted action with the largest logit of an actor in each world."""
    observed, permitted = wide_view(worlds)
    logits = np.where(permitted, forward(layers, observed)[1], -np.inf)
    return np.asarray(logits.argmax(axis=1), np.int64)
