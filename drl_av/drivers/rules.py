"""The rule-based drivers with which the paper compares its driver (Sec. IV-C)."""

import numpy as np
import numpy.typing as npt

from drl_av.config import SafetyConfig
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal, toward
from drl_av.driving.affordances import Affordances
from drl_av.driving.scene import Scene
from drl_av.safety.paper import closing_speed, gap_condition, safe_action, time_to_collision


def idm_action(affordances: Affordances, config: SafetyConfig) -> Longitudinal:
    """The paper's IDM: the action of eq. 3, but accelerate above a time to collision of T_A.

    Ours: it accelerates only if eq. 2 holds. At equal speeds the time to collision is infinite for
    any gap, so that the printed rule would accelerate into the vehicle ahead.
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
    """``idm``: follows the paper's IDM, and never changes lanes."""

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config

    def start(self, seed: int) -> None:
        """Stateless and deterministic."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The action of the paper's IDM, in the own lane."""
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
        """Create the random generator of an episode from its seed."""
        self._rng = np.random.default_rng([seed, 2])

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """One of the 12 actions at random."""
        return ACTIONS[self._rng.integers(len(ACTIONS))]
