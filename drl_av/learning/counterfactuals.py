"""Experience of the decisions that were not made, beside that of the one that was (ours)."""

from collections.abc import Iterable

from drl_av.drivers.network import Float32Array
from drl_av.driving.actions import Action
from drl_av.driving.counterfactual import affordances_after, motion
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.reward import desired, rewards, speed_bonus
from drl_av.learning.buffers import Buffer


def remember_others(
    buffer: Buffer,
    env: HighwayEnv,
    before: Scene,
    s_t: Float32Array,
    executed: Action,
    others: Iterable[Action],
) -> None:
    """Put what other actions would have led to into the buffers, where that is known.

    An action that the check replaces goes into Buf_C, as in Algorithm 1, line 6, and so does one
    that leaves the open lanes; the others lead to what ``counterfactual.seen_after`` says of the
    scene that ``executed`` led to. Under ``learning.unsafe_penalty`` an action that the check
    replaces leads to what its replacement would have led to, where that is known. An imagined
    collision with a vehicle is not known, so not kept.
    """
    config, after = env.config, env.scene.affordances
    penalty = config.learning.unsafe_penalty
    made = motion(before, executed, config)
    width_m = float(before.snapshot.width_m[0])
    for other in others:
        permitted = env.safety_check(before, other).action
        unsafe = permitted != other
        imagined = motion(before, permitted if penalty else other, config)
        on_road = imagined.y_m == before.affordances.ego_y_m or env.road.holds(
            imagined.y_m, width_m
        )
        if not on_road or (unsafe and not penalty):
            buffer.add_collision(s_t, other.number, config.reward.collision_reward)
            continue
        affordances = affordances_after(imagined, made, after, env.road)
        if affordances is None:
            continue
        target = desired(affordances, config.reward, config.safety)
        r_tp1 = rewards(affordances, target, config.reward, config.safety.minimum_gap_m).total
        r_tp1 += speed_bonus(affordances.ego_speed_m_s, config.ego, config.learning.speed_weight)
        if unsafe:
            buffer.add_unsafe(s_t, other.number, r_tp1 - penalty, env.scale(affordances.vector()))
        else:
            buffer.add_safe(s_t, other.number, r_tp1, env.scale(affordances.vector()))
