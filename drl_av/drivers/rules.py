"""Drivers by rule, with which the paper compares the learned one (Sec. IV-C)."""

import numpy as np
import numpy.typing as npt

from drl_av.config import SafetyConfig
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal, toward
from drl_av.driving.affordances import Affordances
from drl_av.driving.scene import Scene
from drl_av.safety.paper import closing_speed, gap_condition, safe_action, time_to_collision


def idm_action(affordances: Affordances, config: SafetyConfig) -> Longitudinal:
    """The paper's IDM: eq. 3, and accelerate above a time to collision of T_A.

    Ours: only where eq. 2 holds. At equal speeds the time to collision is infinite however small
    the gap is, and the rule as printed accelerates into the vehicle ahead.
    """
    front = affordances.own_front
    if front is None:
        return Longitudinal.ACCELERATE
    closing = closing_speed(front)
    ttc_s = time_to_collision(front.gap_m, closing)
    if ttc_s > config.accelerate_ttc_s and gap_condition(front.gap_m, closing, config):
        return Longitudinal.ACCELERATE
    return safe_action(ttc_s, config)


class IdmDriver:
    """``idm``: the paper's IDM in the lane, no lane changes."""

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config

    def start(self, seed: int) -> None:
        """Stateless and deterministic."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Keep the lane, at the speed that the IDM asks for."""
        return Action(Lateral.KEEP, idm_action(scene.affordances, self._config))


class IdmSumoDriver(IdmDriver):
    """``idm-sumo``: as ``idm``, with the lane changes of SUMO's lane-change model (SL2015)."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The IDM's speed and SUMO's lane change; one in progress is completed."""
        sign = scene.snapshot.sumo_lane_change if scene.lane_change is None else 0
        return Action(toward(sign), idm_action(scene.affordances, self._config))


class RandomDriver:
    """``random``: each of the 12 actions with equal probability."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng()

    def start(self, seed: int) -> None:
        """Seed the generator of the actions."""
        self._rng = np.random.default_rng([seed, 2])

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """One of the 12 actions, drawn."""
        return ACTIONS[self._rng.integers(len(ACTIONS))]
