"""What many worlds say of a decision, ``info`` and transitions, as ``HighwayEnv`` says it."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from drl_av.arrays import BoolArray, IntArray
from drl_av.driving.actions import ACTIONS
from drl_av.driving.scene import Scene
from drl_av.env.reward import Rewards
from drl_av.env.transition import COMPLETE, Transition
from drl_av.env.world_arrays import WorldArrays
from drl_av.road.snapshot import Collision
from drl_av.road.sweep import KINDS, NO_CONTACT
from drl_av.safety.check import RULES

Decided = tuple[IntArray, IntArray, IntArray]
"""The numbers of the proposed and of the executed actions, and the rules, shape (worlds,) each."""
RULE_WORDS = np.array([str(rule) for rule in RULES], dtype=object)
COLLISION_WORDS = np.array([*(kind.value for kind in KINDS), ""], dtype=object)
"""By number; -1, no collision, is the last."""
EGO_HITS = np.array([*(kind.ego_hit for kind in KINDS), False])


def marked(info: dict[str, Any], present: BoolArray) -> dict[str, Any]:
    """Return ``info`` and, as gymnasium's vector environments do, which worlds have each entry."""
    return info | {f"_{name}": present for name in info}


def with_final(info: dict[str, Any], last: Iterable[Any], over: BoolArray) -> dict[str, Any]:
    """Return ``info`` and what gymnasium keeps of the episodes that are over and begin again.

    ``last`` has each world's observation.
    """
    kept = [row if ended else None for row, ended in zip(last, over, strict=True)]
    final_obs = np.full(len(kept), None, dtype=object)
    final_obs[:] = kept
    ends = {"final_obs": final_obs, "final_info": present_in(info, over)}
    return present_in(info, ~over) | marked(ends, over)


def present_in(info: dict[str, Any], worlds: BoolArray) -> dict[str, Any]:
    """Return a copy of ``info`` that only some of its worlds have, bool of shape (worlds,)."""
    return {
        name: present_in(value, worlds)
        if isinstance(value, dict)
        else value & worlds
        if name.startswith("_")
        else value.copy()
        for name, value in info.items()
    }


def common_info(worlds: WorldArrays, action_mask: npt.NDArray[np.int8] | None) -> dict[str, Any]:
    """Return the present scenes' part of ``info``."""
    values = worlds.episodes.values[:, :27].copy()
    info: dict[str, Any] = {
        "seed": worlds.seeds.copy(),
        "vehicles": worlds.vehicles.copy(),
        "speed_m_s": values[:, 24].copy(),
        "indicators": values,
        "way": worlds.ways.copy(),
    }
    if action_mask is not None:
        info["action_mask"] = action_mask
    return marked(info, np.ones(worlds.num_envs, np.bool_))


def step_info(
    worlds: WorldArrays, over: BoolArray, decided: Decided, present: BoolArray
) -> dict[str, Any]:
    """Return what only a step has in ``info``.

    Args:
        worlds: The worlds after the decisions.
        over: Whose episodes are over, shape (worlds,).
        decided: What they decided.
        present: Which worlds have made a decision.
    """
    episodes, kind = worlds.episodes, worlds.episodes.collision[:, 0]
    hits = kind != NO_CONTACT
    proposed, executed, rules = decided
    r_v, r_y, r_x = episodes.terms.T.copy()
    info: dict[str, Any] = {
        "is_success": over & ~hits & np.isin(worlds.ways, ("", *COMPLETE)),
        "mean_speed_m_s": episodes.sums[:, 0] / np.maximum(episodes.decisions, 1),
        "ego_hit": EGO_HITS[kind],
        "safety_triggers": episodes.sums[:, 1].astype(np.int64),
        "proposed_action": proposed,
        "executed_action": executed,
        "rule": RULE_WORDS[rules],
        "rewards": marked({"r_v": r_v, "r_y": r_y, "r_x": r_x}, present),
        "collision": COLLISION_WORDS[kind],
        "collided_with": worlds.collided_with.copy(),
    }
    return marked(info, present)


def transition_of(
    worlds: WorldArrays,
    row: int,
    seen: tuple[tuple[Scene, Any], tuple[Scene, Any]],
    decided: Decided,
    outcome: Sequence[npt.NDArray[Any]],
) -> Transition:
    """Return the record of a world's decision.

    Args:
        worlds: The worlds after the decisions.
        row: The world.
        seen: Its scene and observation before the decision and after it.
        decided: What the worlds decided.
        outcome: The rewards, and whether the episodes terminated and were truncated.
    """
    (scene, observation), (next_scene, next_observation) = seen
    proposed, executed, rule = (int(each[row]) for each in decided)
    kind, other = int(worlds.episodes.collision[row, 0]), worlds.collided_with[row]
    route = worlds.routes.get(row)
    reward, terminated, truncated = (each[row].item() for each in outcome)
    return Transition(
        scene,
        observation,
        ACTIONS[proposed],
        ACTIONS[executed],
        RULES[rule],
        next_scene,
        next_observation,
        None if kind == NO_CONTACT else Collision(KINDS[kind], other or None),
        Rewards(*worlds.episodes.terms[row].tolist()),
        reward,
        terminated,
        truncated,
        worlds.ways[row],
        route is not None and route.misses_exit(next_scene.indicators),
    )
