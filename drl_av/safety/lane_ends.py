"""The check ``paper`` on an open road, where lanes end (ours)."""

import numpy as np

from drl_av.compiled import numbers
from drl_av.config import Config
from drl_av.driving.actions import ego_numbers
from drl_av.driving.affordances import FRONT, NO_VEHICLE
from drl_av.driving.scene import Scene
from drl_av.safety.check import Verdicts
from drl_av.safety.paper import Paper, paper_verdicts
from drl_av.safety.reachability import StrictNumbers
from drl_av.safety.strict import strict_verdicts


class PaperBeforeLaneEnds(Paper):
    """``paper``, and the ego stays able to stop before its lane ends.

    The paper has no lane that ends. As a vehicle that stands there, the end would be braked for too
    late: with the thresholds of the safe action (eq. 4), 2 and 3 s, the ego stops from each speed
    up to 14 m/s, and from none above 20 m/s. Rules 1 and 3 therefore do not see the end of the
    ego's own lane. The action that they return is then replaced as ``strict`` would on the road
    without other vehicles, which covers the divider of a ramp too. That argument needs
    ``ego.lateral_plant = "kinematic"``; a steered ego may drift a little beyond.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config.safety)
        self._strict = numbers(StrictNumbers, config.strict)
        self._ego = ego_numbers(config.ego, config.simulation)

    def verdicts(self, scene: Scene) -> Verdicts:
        """Return the verdicts of the three rules and of the lane ends on all 12 actions."""
        values, codes, ground, *_ = scene.indicators
        if not len(ground[2]):
            return super().verdicts(scene)
        shot, lanes = scene.snapshot, scene.lanes
        found, alone = (Verdicts(*np.empty((2, 12), np.int64)) for _ in range(2))
        vehicles = codes.copy()
        if codes[0] >= len(shot.ids):  # the end of the lane
            vehicles[0] = NO_VEHICLE
        paper_verdicts.fast(values, vehicles, *lanes, self._config, *found)
        around = *lanes, *ground, values[FRONT], self._strict, self._ego
        ego = (each[:1] for each in shot.arrays)
        strict_verdicts.fast(*ego, codes, *around, *alone)
        executed = alone.executed[found.executed]
        rules = found.rules | alone.rules[found.executed]
        rules[executed == np.arange(12)] = 0
        return Verdicts(executed, rules)
