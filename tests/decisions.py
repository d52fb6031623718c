"""Decisions made by hand, of which a test says only what it is about."""

from typing import Any

import numpy as np
from worlds import ALONE

from drl_av.driving.actions import ACTIONS
from drl_av.driving.scene import Scene
from drl_av.env.reward import Rewards
from drl_av.env.transition import Transition
from drl_av.road.snapshot import Collision
from drl_av.safety.check import Rule

NOTHING = np.zeros(27, np.float32)


def decided(
    before: Scene = ALONE,
    after: Scene | None = None,
    executed: int = 0,
    *,
    proposed: int | None = None,
    collision: Collision | None = None,
    terms: tuple[float, float, float] = (0.0, 0.0, 0.0),
    **fields: Any,
) -> Transition:
    """A decision of which nothing but the scene is left as it was, if not said otherwise."""
    made = Transition(
        scene=before,
        observation=NOTHING,
        proposed=ACTIONS[executed if proposed is None else proposed],
        executed=ACTIONS[executed],
        rule=Rule.NONE,
        next_scene=before if after is None else after,
        next_observation=NOTHING,
        collision=collision,
        terms=Rewards(*terms),
        reward=0.0,
        terminated=collision is not None,
        truncated=False,
        route_outcome="",
        missed_exit=False,
    )
    return made._replace(**fields)
