"""Wrappers: a driver that drives steadily, and a function as driver."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from drl_av.arrays import Float32Array
from drl_av.config import Config
from drl_av.config.functions import require_function
from drl_av.drivers.driver import Driver, ask
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal, action_of, ego_numbers
from drl_av.driving.affordances import compute_indicators
from drl_av.driving.maneuver import plan_with
from drl_av.driving.scene import LaneChange, Scene, unwritable
from drl_av.road.road import Road
from drl_av.road.snapshot import EGO, EGO_ID, Snapshot
from drl_av.safety import action_mask
from drl_av.safety.check import Rule, SafetyCheck, apply_check

STEADY = ACTIONS[0]
"""Keep the lane and the speed."""


class SteadyDriver(Driver):
    """A driver that begins only what it can go on with (ours).

    A driver that accelerates behind a slower vehicle whenever the check permits has to brake a
    second later, and so on; most lane changes that are aborted are those with which the check does
    not let it go on after a second. This one accelerates only if the check would still permit the
    higher speed ``hold_s`` seconds later, and begins a lane change only if the check would permit
    to go on with it at the next decision, both if the others keep their speeds.

    Args:
        driver: The driver that proposes.
        check: The safety check under which it drives.
        config: The settings of the environment; ``driver.hold_s`` is the time.
    """

    def __init__(self, driver: Driver, check: SafetyCheck, config: Config) -> None:
        self.inner, self._check = driver, check
        self._hold_s, self._range_m = config.driver.hold_s, config.observation.range_m
        self._interval_s = config.simulation.decision_interval_s
        self._ego = ego_numbers(config.ego, config.simulation)

    def start(self, seed: int) -> None:
        """Prepare the inner driver for an episode."""
        self.inner.start(seed)

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return the inner driver's proposal, without what it could not go on with."""
        proposed = ask(self.inner, scene, observation)
        begins = proposed.lateral is not Lateral.KEEP and scene.lane_change is None
        if begins and not self._goes_on(scene, proposed):
            proposed = self._instead(scene, proposed, proposed._replace(lateral=Lateral.KEEP))
        if proposed.longitudinal is Longitudinal.ACCELERATE and not self._holds(scene, proposed):
            steady = proposed._replace(longitudinal=Longitudinal.MAINTAIN)
            proposed = self._instead(scene, proposed, steady)
        return proposed

    def _instead(self, scene: Scene, proposed: Action, other: Action) -> Action:
        return other if self._permits(scene, other) else proposed

    def _permits(self, scene: Scene, action: Action) -> bool:
        return apply_check(self._check, scene, action).rule is Rule.NONE

    def _goes_on(self, scene: Scene, begun: Action) -> bool:
        """Return whether the check permits to go on with a lane change at the next decision."""
        shot, (commands, change) = scene.snapshot, plan_with(scene, begun, self._ego)
        s_m, y_m, speed_m_s, lateral_m_s, length_m, width_m = (each.copy() for each in shot.arrays)
        s_m += speed_m_s * self._interval_s
        mean_m_s = sum(command.speed_m_s for command in commands) / len(commands)
        s_m[EGO] = shot.s_m[EGO] + mean_m_s * self._interval_s
        y_m += lateral_m_s * self._interval_s
        speed_m_s[EGO], y_m[EGO], lateral_m_s[EGO] = commands[-1]
        moved = s_m % scene.road.lap_m, y_m, speed_m_s, lateral_m_s
        later = Snapshot(shot.time_s, shot.ids, *moved, length_m, width_m)
        then = self._seen(later, change, scene.road)
        return bool(action_mask(self._check, then)[: len(Longitudinal)].any())

    def _holds(self, scene: Scene, faster: Action) -> bool:
        """Return whether the check permits the higher speed until the end of the time."""
        shot, front = scene.snapshot, scene.affordances.front(0)
        if front is None or front.vehicle >= len(shot.ids):  # free, or the end of the lane
            return True
        speed = plan_with(scene, faster, self._ego).commands[-1].speed_m_s
        closer_m = (speed - float(shot.speed_m_s[front.vehicle])) * self._hold_s
        if closer_m <= 0 or closer_m >= front.gap_m:
            return closer_m <= 0
        rows = [EGO, front.vehicle]
        s_m, y_m, speed_m_s, lateral_m_s, length_m, width_m = (each[rows] for each in shot.arrays)
        s_m[1], speed_m_s[EGO] = (s_m[1] - closer_m) % scene.road.lap_m, speed
        moved = s_m, y_m, speed_m_s, lateral_m_s
        later = Snapshot(shot.time_s, (EGO_ID, "ahead"), *moved, length_m, width_m)
        return self._permits(self._seen(later, scene.lane_change, scene.road), STEADY)

    def _seen(self, shot: Snapshot, change: LaneChange | None, road: Road) -> Scene:
        return Scene(shot, compute_indicators(shot, road, self._range_m), change, road)


class PolicyDriver(Driver):
    """A driver whose action is the number that a function of the observation returns.

    With stable-baselines3 pass ``lambda o: model.predict(o, deterministic=True)[0]``.

    Args:
        policy: The function from an observation to an action number, or to an array of one such
            number.
        observe: The function from a scene to the observation, for a policy that was trained with
            another observation. If it is None, the policy gets the environment's observation.

    Raises:
        ConfigError: ``policy`` or ``observe`` is not a function of one argument.
    """

    def __init__(
        self,
        policy: Callable[[Any], int | np.integer | npt.NDArray[Any]],
        observe: Callable[[Scene], Any] | None = None,
    ) -> None:
        require_function(policy, "policy", "observation")
        if observe is not None:
            require_function(observe, "observe", "scene")
        self._policy, self._observe = policy, observe

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Call the function with the observation, and return the action with the returned number.

        Raises:
            ConfigError: the function returns anything but an integer from 0 to 11.
        """
        with unwritable(self._observe, scene):
            observed = observation if self._observe is None else self._observe(scene)
        return action_of(self._policy(observed))
