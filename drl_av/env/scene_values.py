"""Computes the indicators, the observation and the reward of a scene in one compiled call."""

import numpy as np

from drl_av.arrays import Float32Array, FloatArray, IntArray
from drl_av.compiled import borrowing
from drl_av.config import Config, RewardConfig, SafetyConfig
from drl_av.driving.affordances import CODES, VALUES, Indicators, ground_of, indicators
from drl_av.driving.observation_scale import ObservationScale, ScaleArrays, scale_into
from drl_av.driving.scene import LaneChange, Scene
from drl_av.env.reward import Rewards, reward_terms
from drl_av.road.road import Road, RoadNumbers, road_numbers
from drl_av.road.snapshot import Snapshot, Vehicles

Observation = Float32Array


class SceneValues:
    """Computes the values of scenes on one road, with the settings of one environment."""

    def __init__(self, config: Config, road: Road, scale: ObservationScale) -> None:
        self._road, self._range_m = road, float(config.observation.range_m)
        self._numbers = road_numbers(road)
        self._ground = ground_of(self._numbers)
        rewards = config.reward.numbers, config.safety.numbers
        self._given = self._numbers, self._range_m, scale.arrays, *rewards

    def __call__(
        self, snapshot: Snapshot, lane_change: LaneChange | None
    ) -> tuple[Scene, Observation, Rewards]:
        """Return the scene, the scaled 27 indicators, and the reward terms of the scene."""
        values, codes = np.empty(VALUES), np.empty(CODES, np.int64)
        observation = np.empty(27, np.float32)
        terms = compute_values.fast(snapshot.arrays, *self._given, values, codes, observation)
        limits = self._numbers.speed_limits
        found = Indicators(values, codes, self._ground, self._range_m, limits)
        scene = Scene(snapshot, found, lane_change, self._road)
        return scene, observation, Rewards(*terms)


@borrowing
def compute_values(
    scene: Vehicles,
    road: RoadNumbers,
    range_m: float,
    scale: ScaleArrays,
    reward: RewardConfig,
    safety: SafetyConfig,
    values: FloatArray,
    codes: IntArray,
    observation: Observation,
) -> tuple[float, float, float]:
    """Fill ``values`` and ``codes`` (``indicators``) and ``observation``; return the reward terms.

    ``scene`` is ``Snapshot.arrays``.
    """
    indicators(scene, road, range_m, values, codes)
    scale_into(values, scale, observation)
    return reward_terms(values, codes, road.lane_width_m, reward, safety)
