"""Scales the 27 indicators for the input of the network (ours)."""

import math
from typing import NamedTuple

import numpy as np

from drl_av.arrays import Float32Array, FloatArray
from drl_av.compiled import borrowing
from drl_av.config import ObservationConfig
from drl_av.road.road import Road

_MEANINGS = {
    "d_x": "net gap, bumper to bumper, m",
    "v_x": "relative velocity, m/s; negative for a vehicle ahead that comes nearer",
    "d_y": "relative lateral position, m; left positive",
    "v_y": "relative lateral velocity, m/s; left positive",
    "ego_v_x": "speed of the ego, m/s",
    "ego_d_y": "lateral position of the ego from the centre of the rightmost lane, m",
    "ego_v_y": "lateral velocity of the ego, m/s; left positive",
}


def indicator_meaning(name: str) -> str:
    """Return what an indicator means, with its unit."""
    return _MEANINGS[name if name in _MEANINGS else name[-3:]]


def indicator_scales(config: ObservationConfig, max_speed_m_s: float) -> FloatArray:
    """Return the constant by which each indicator is divided, shape (27,)."""
    lateral = config.lateral_scale_m, config.lateral_speed_scale_m_s
    vehicle = config.gap_scale_m, config.speed_scale_m_s, *lateral
    return np.array([*vehicle * 6, max_speed_m_s / 2, *lateral])


def indicator_bounds(
    config: ObservationConfig,
    max_speed_m_s: float,
    widest_m: float = math.nan,
    half_road_m: float = math.nan,
) -> Float32Array:
    """Return the largest absolute value of each scaled indicator, shape (27,).

    ``widest_m`` and ``half_road_m``, the largest lateral distances of others and of the ego, depend
    on the road; without them these bounds are nan.
    """
    limits = config.range_m, 60.0, widest_m, 4.0
    ends = np.array([*limits * 6, max_speed_m_s / 2, half_road_m, 4.0])
    bounds: Float32Array = (ends / indicator_scales(config, max_speed_m_s)).astype("f4")
    return bounds


class ScaleArrays(NamedTuple):
    """How the 27 indicators are scaled, for compiled functions; each array has shape (27,)."""

    offset: FloatArray
    scale: FloatArray
    bounds: Float32Array


class ObservationScale:
    """Scales the 27 indicators to about [-1, 1] for the input of the network (ours).

    First, half of the top speed is subtracted from the ego's speed, and the middle of the road from
    the ego's lateral position. Then each indicator is divided by a constant of the config, and
    clipped to [-bounds, bounds].
    """

    def __init__(self, config: ObservationConfig, max_speed_m_s: float, road: Road) -> None:
        self.lanes = len(road.open_lanes)
        """Number of lanes of the road."""
        self.road, self.range_m, self.max_speed_m_s = road, config.range_m, max_speed_m_s
        middle_m = road.lane_width_m * (self.lanes - 1) / 2
        self.offset = np.array([0.0] * 24 + [max_speed_m_s / 2, middle_m, 0.0])
        self.scale = indicator_scales(config, max_speed_m_s)
        widths_m = road.lane_width_m * (self.lanes + 1), road.lane_width_m * self.lanes / 2
        self.bounds = indicator_bounds(config, max_speed_m_s, *widths_m)
        """Largest absolute value of each scaled indicator, shape (27,)."""
        self.arrays = ScaleArrays(self.offset, self.scale, self.bounds)
        self._least = -self.bounds

    def __call__(self, vector: FloatArray) -> Float32Array:
        """Scale indicators in SI units, shape (..., 27); return float32 of the same shape."""
        scaled = ((vector - self.offset) / self.scale).astype(np.float32)
        # np.minimum uses AVX-512, after which SUMO's next step takes 15 % longer
        clipped: Float32Array = scaled.clip(self._least, self.bounds)
        return clipped


@borrowing
def scale_into(values: FloatArray, arrays: ScaleArrays, observation: Float32Array) -> None:
    """Scale the 27 indicators like ``ObservationScale``, into ``observation``, shape (27,)."""
    offset, scale, bounds = arrays
    for row in range(len(observation)):
        scaled = np.float32((values[row] - offset[row]) / scale[row])
        observation[row] = min(max(scaled, -bounds[row]), bounds[row])
