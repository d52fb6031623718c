"""The docstring of ``HighwayEnv``, with gymnasium's headings and tables made from the code."""

from drl_av.driving.actions import ACTIONS
from drl_av.driving.affordances import INDICATORS
from drl_av.env.observation import GROUPS

TEXT = """The ego on a highway with other vehicles, one decision a second (Fig. 3 of the paper).

## Description
A circular highway of three lanes represents an infinite straight highway. IDM, finite-state,
level-0 and level-1 drivers drive the other vehicles, a quarter of each; on an open road SUMO drives
them all. A safety check examines each action of the agent before the ego executes it.

## Action Space
`Discrete(12)`, `4 * lateral + longitudinal`:

{actions}

## Observation Space
`Box` of shape (27,), float32: the affordance indicators, scaled to about [-1, 1] by
`config.observation` and clipped to the box. `info["indicators"]` holds them in SI units.

{indicators}

## Rewards
The mean of r_v, r_y and r_x (eq. 7 to 9), each in [-1, 0]. The decision in which the ego
collides has the reward `config.reward.collision_reward` instead.

## Starting State
On a loop the other vehicles are at random positions within 250 m of the ego; an open road begins
with the vehicles of its flow. The number on a loop is
`options={{"vehicles": n}}`, or is drawn from the range in the config.

`reset(seed=7, options={{"vehicles": 30}})` always starts the same episode, which `drl-av evaluate`
also drives for these numbers. Clients pass a small seed to their first reset. Without `vehicles`, a
seed below 1,000,000 seeds the random choice of episodes for this reset and the following resets
without a seed. These episodes have seeds of at least 1,000,000, so that no training uses
an episode of the evaluation. The info of a reset holds the episode's `seed` and `vehicles`; pass
both to `reset` to start the episode again. Changes that your own program makes in SUMO, such as the
permissions of a lane, remain until `close`.

## Episode End
The episode terminates when the ego collides. It is truncated after
`config.simulation.decisions_per_episode` decisions, which is also `env.spec.max_episode_steps`. An
open road also truncates it at the road's end. A road with an exit ends 100 m beyond the exit, which
the ego has then taken or missed. The environment truncates without gymnasium's `TimeLimit`.

## Arguments
`scenario` (folder or name), `safety_check` (name or function), `config` (a preset's name, a
TOML file, `{{"traffic": {{"vehicles_max": 5}}}}` or a Config),
`render_mode` ("human" is sumo-gui, "rgb_array" needs no screen), `action_mask` (whether `info`
contains the mask; True by `gymnasium.make`, False by default in this class),
`reward` (a function of a `Transition` that replaces the reward; `info["rewards"]` stays),
`observation` (names of groups of indicators, {groups}; "wide";
or an object with an attribute `space` that is called with the scene),
`sumo_options` (options of SUMO itself, such as "--fcd-output fcd.xml"; SUMO then starts again at
each reset).
A wrong argument or setting, or one that `strict` refuses, raises `ConfigError`; a scenario that is
missing or damaged raises `ScenarioError`.

## Information
`proposed_action, executed_action, rule, rewards, collision, collided_with, way, speed_m_s,
indicators, seed, vehicles, action_mask`, and for the episode so far `mean_speed_m_s, ego_hit,
safety_triggers, is_success`. The last is True in the last decision of an episode without a
collision whose ego has taken its exit or merged, if it has to. No value is None, which some
libraries refuse to store. `collision` and `collided_with` are texts, empty without a collision.
`way` is `exit taken`, `exit missed`, `merged` or `not merged` once the ego has passed its exit or
the end of its lane, and in the last decision; before, and on a road without an exit or a merge, it
is empty. The mask has shape (12,) and type int8. It is 1 for each action that the safety check
would not replace now; `action_space.sample(mask)` accepts it. The info of a reset also holds
`unsafe_start`: whether the ego starts in a scene in which the check `strict` cannot guarantee to
avoid a collision.

## Several at Once
Each environment has its own SUMO, also within one process. The first environment uses the
installed libsumo. Each further one loads a copy of the library (30 ms, 20 MiB), which later
environments reuse after `close`. All environments of one process share one core. To use several
cores, call `make_vec(..., vectorization_mode="async", vector_kwargs={{"context": "spawn"}})`.
sumo-gui shows only one environment of a process at a time.
"""
DOCSTRING = TEXT.format(
    actions="\n".join(
        ["| action | meaning |", "| --- | --- |"]
        + [f"| {action.number} | {action} |" for action in ACTIONS]
    ),
    indicators="\n".join(
        ["| place | indicator |", "| --- | --- |"]
        + [f"| {place} | {name} |" for place, name in enumerate(INDICATORS)]
    ),
    groups=", ".join(f"`{group}`" for group in GROUPS),
)
