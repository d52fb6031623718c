"""Rule-based drivers: the two baselines of Sec. IV-C of the paper, and a random driver."""

import numpy as np
import numpy.typing as npt

from drl_av.config import SafetyConfig
from drl_av.drivers.driver import Driver
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal, toward
from drl_av.driving.affordances import Affordances
from drl_av.driving.scene import Scene
from drl_av.random_streams import Stream, generator
from drl_av.safety.paper import closing_speed, gap_condition, safe_action, time_to_collision


def idm_action(affordances: Affordances, config: SafetyConfig) -> Longitudinal:
    """Choose the longitudinal action of the paper's IDM, with one added condition.

    The action is to accelerate if T_C > T_A and the gap condition (eq. 2) holds, and otherwise that
    of eq. 3. T_C is the time to collision with the vehicle ahead, s, infinite without a vehicle;
    T_A is ``config.accelerate_ttc_s``. The gap condition is ours: at equal speeds T_C is infinite
    at any gap, so without it the ego would accelerate into the vehicle ahead.
    ``config.printed_idm`` removes the condition, as in the paper.
    """
    front = affordances.own_front
    if front is None:
        return Longitudinal.ACCELERATE
    closing = closing_speed(front)
    ttc_s = time_to_collision(front.gap_m, closing)
    may_close_in = config.printed_idm or gap_condition(front.gap_m, closing, config)
    if ttc_s > config.accelerate_ttc_s and may_close_in:
        return Longitudinal.ACCELERATE
    return safe_action(ttc_s, config)


class IdmDriver(Driver):
    """The driver ``idm``: follows the paper's IDM, and never changes lanes."""

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Keep the lane, with the longitudinal action of the paper's IDM."""
        return Action(Lateral.KEEP, idm_action(scene.affordances, self._config))


class IdmSumoDriver(IdmDriver):
    """The driver ``idm-sumo``: ``idm``, plus the lane changes that SUMO's SL2015 would make."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the IDM's longitudinal action, with the lane change that SUMO's model demands.

        A lane change in progress is always completed.
        """
        sign = scene.snapshot.sumo_lane_change if scene.lane_change is None else 0
        return Action(toward(sign), idm_action(scene.affordances, self._config))


class RandomDriver:
    """The driver ``random``: chooses each of the 12 actions with equal probability."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng()

    def start(self, seed: int) -> None:
        """Create the random generator of the episode from ``seed``."""
        self._rng = generator(seed, Stream.RANDOM_DRIVER)

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Draw one of the 12 actions."""
        return ACTIONS[self._rng.integers(len(ACTIONS))]
