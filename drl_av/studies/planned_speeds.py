"""How much better a driver's speeds could be chosen: by trying every sequence on the reward (ours).

What it gains over the driver itself tells what a better choice of speeds might bring. It is no
bound: no vehicle keeps its speed for long, and elsewhere or at another speed the driver changes
lanes otherwise, which the plan does not count.
"""

from itertools import product

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.affordances import Neighbor
from drl_av.driving.drivers import Driver
from drl_av.driving.maneuver import Scene, steered
from drl_av.traffic.ring import FloatArray


class PlannedSpeeds:
    """The lane changes of a driver, at the speeds that the reward asks for.

    At each decision it takes the first of those ``horizon`` longitudinal decisions that have the
    greatest discounted sum of r_v and r_x. Every sequence is tried in a world in which the vehicle
    ahead keeps its speed, and the one ahead in the other lane takes its place as soon as the
    ego's lane change brings its centre there. For the reward ``traffic`` and the kinematic plant.
    """

    def __init__(self, driver: Driver, config: Config, horizon: int) -> None:
        self._driver, self._config = driver, config
        numbers = [word.acceleration_m_s2(config.ego) for word in Longitudinal]
        self._accelerations = np.array([*product(numbers, repeat=horizon)]).T

    def start(self, seed: int) -> None:
        """Get the driver ready for an episode."""
        self._driver.start(seed)

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The driver's lateral action with the planned longitudinal one."""
        lateral = self._driver.act(scene, observation).lateral
        best = int(self._returns(scene, lateral).argmax())
        return Action(
            lateral, Longitudinal(best * len(Longitudinal) // self._accelerations.shape[1])
        )

    def _returns(self, scene: Scene, lateral: Lateral) -> FloatArray:
        """The discounted sum of each sequence, shape (4 ** horizon,)."""
        simulation, ego = self._config.simulation, self._config.ego
        ends_s = simulation.step_length_s * np.arange(1, simulation.steps_per_decision + 1)
        start_m_s = scene.seen.ego_speed_m_s
        speed_m_s = np.full(self._accelerations.shape[1], start_m_s)
        driven_m, returns = np.zeros((2, len(speed_m_s)))
        sign, crosses_s = self._crossing(scene, lateral)
        for number, acceleration in enumerate(self._accelerations):
            speeds = speed_m_s[:, None] + acceleration[:, None] * ends_s
            speeds = np.clip(speeds, 0.0, ego.max_speed_m_s)
            driven_m = driven_m + simulation.step_length_s * speeds.sum(axis=1)
            speed_m_s = speeds[:, -1]
            passed_s = (number + 1) * simulation.decision_interval_s
            front = scene.seen.front(sign if passed_s >= crosses_s else 0)
            discount = self._config.learning.discount**number
            returns += discount * self._reward(speed_m_s, driven_m, front, start_m_s, passed_s)
        return returns

    def _crossing(self, scene: Scene, lateral: Lateral) -> tuple[int, float]:
        """To which side the ego's centre comes into another lane, and in how many seconds."""
        seen = scene.seen
        lane_change = steered(scene.lane_change, seen.lane, lateral)
        if lane_change is None or lane_change.target == seen.lane:
            return 0, 0.0
        sign = lane_change.sign
        left_m = seen.lane_width_m / 2 - sign * (seen.ego_y_m - seen.lane_center_m)
        return sign, left_m * self._config.ego.lane_change_duration_s / seen.lane_width_m

    def _reward(
        self,
        speed_m_s: FloatArray,
        driven_m: FloatArray,
        front: Neighbor | None,
        start_m_s: float,
        passed_s: float,
    ) -> FloatArray:
        """r_v + r_x (eq. 6 and 8) of many ego speeds, against the reward ``traffic``."""
        reward, least_m = self._config.reward, self._config.safety.minimum_gap_m
        if front is None:
            return _bell(speed_m_s - reward.desired_speed_m_s, 10.0)
        leader_m_s = start_m_s + front.relative_speed_m_s
        gap_m = front.gap_m + leader_m_s * passed_s - driven_m
        spare_m = gap_m - max(reward.safe_headway_s * leader_m_s, least_m)
        attainable = leader_m_s + np.maximum(spare_m, 0.0) / reward.catch_up_time_s
        r_v = _bell(speed_m_s - np.minimum(attainable, reward.desired_speed_m_s), 10.0)
        safe_m = np.maximum(reward.safe_headway_s * speed_m_s, least_m)
        return r_v + _bell(np.minimum(gap_m - safe_m, 0.0), 10.0 * safe_m)


def _bell(off: FloatArray, width: FloatArray | float) -> FloatArray:
    values: FloatArray = np.exp(-(off**2) / width) - 1.0
    return values
