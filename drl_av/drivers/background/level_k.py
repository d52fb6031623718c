"""Level-k drivers of the traffic: level 0 follows a rule; level k responds best to level k - 1.

Source: Li, Oyler, Zhang, Yildiz, Kolmanovsky and Girard 2017. The rule of level 0 is that of Albaba
and Yildiz 2020. The accelerations are those of the ego's actions.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from drl_av.arrays import Float32Array, FloatArray, IntArray
from drl_av.compiled import borrowing
from drl_av.config import Config, Level0Config, SafetyConfig
from drl_av.drivers.network import LEAK, Layers, leaky_relu
from drl_av.drivers.policy_file import load_run
from drl_av.driving.actions import ACCELERATE, ACTIONS, BRAKE, HARD_BRAKE, MAINTAIN, SIGNS
from drl_av.driving.affordances import LANE, gap_in, has_lane
from drl_av.driving.observation_scale import ObservationScale, ScaleArrays, scale_into
from drl_av.errors import CheckpointError, DrlAvError
from drl_av.road.road import CENTERED_M, Road
from drl_av.safety.paper import is_clear

LEVELS = {k: Path(__file__).parents[2] / "pretrained" / f"level_{k}" for k in (1, 2)}
"""Folders of the shipped level-1 and level-2 policies, in the layout of a run's folder."""

LEVEL_0 = (
    *(HARD_BRAKE, BRAKE, MAINTAIN),
    *(BRAKE, MAINTAIN, ACCELERATE),
    *(ACCELERATE, ACCELERATE, ACCELERATE),
)
"""The action of a level-0 driver. The row is the gap to the vehicle ahead (close, nominal, far),
the column is the change of this gap (it shrinks, is stable, grows)."""


def level_0(values: FloatArray, codes: IntArray, config: Level0Config) -> int:
    """Return the number of the longitudinal action of a level-0 driver, by the table LEVEL_0.

    ``values`` and ``codes`` are those of ``indicators``. The driver makes no lane changes.
    """
    gap_m, faster_m_s = gap_in(values, codes, 0), values[1]
    distance = 0 if gap_m <= config.close_m else 1 if gap_m <= config.nominal_m else 2
    motion = 1
    if abs(faster_m_s) > config.stable_m_s:
        motion = 2 if faster_m_s > 0.0 else 0
    return LEVEL_0[3 * distance + motion]


class LevelKNumbers(NamedTuple):
    """A level-k driver: the greedy policy of a network that was trained in level-(k - 1) traffic.

    Unlike the learned drivers of the ego, the driver uses no mirror images.
    """

    layers: tuple[tuple[Float32Array, Float32Array], ...]
    """The weight of each layer, shape (inputs, outputs), and its bias."""
    range_m: float
    scale: ScaleArrays
    """These two as in ``ObservationScale``, by the config of the training."""
    acceleration_m_s2: FloatArray
    """That of each action, shape (12,)."""
    safety: SafetyConfig
    units: int
    """The number of units of the widest layer, the inputs included."""


NO_LEVEL_K = LevelKNumbers(
    layers=3 * ((np.zeros((0, 0), np.float32), np.zeros(0, np.float32)),),
    range_m=0.0,
    scale=ScaleArrays(np.zeros(0), np.zeros(0), np.zeros(0, np.float32)),
    acceleration_m_s2=np.zeros(0),
    safety=SafetyConfig().numbers,
    units=0,
)
"""Takes the place of the driver in traffic without any; its types are the usual ones."""


def level_k_numbers(layers: Layers, config: Config, road: Road) -> LevelKNumbers:
    """Return the driver of a network; ``config`` is the config of its training."""
    scale = ObservationScale(config.observation, config.ego.max_speed_m_s, road)
    return LevelKNumbers(
        layers=tuple((np.ascontiguousarray(weight.T), bias.copy()) for weight, bias in layers),
        range_m=float(config.observation.range_m),
        scale=scale.arrays,
        acceleration_m_s2=np.array(
            [action.longitudinal.acceleration_m_s2(config.ego) for action in ACTIONS], np.float64
        ),
        safety=config.safety.numbers,
        units=max(size for weight, _ in layers for size in weight.shape),
    )


@borrowing
def level_k(
    values: FloatArray,
    codes: IntArray,
    lane_width_m: float,
    driver: LevelKNumbers,
    units: Float32Array,
) -> tuple[float, int]:
    """Return the acceleration, m/s^2, and the lane change with the greatest Q-value.

    As in its training, a vehicle requests a lane change only if rules 2 and 3 of the check
    ``paper`` permit it. It requests none during a lane change, because SUMO cannot abort one.
    ``units`` is scratch, shape (2, ``driver.units``).
    """
    entered, sums = units[0], units[1]
    scale_into(values, driver.scale, entered[: len(driver.scale.bounds)])
    last = len(driver.layers) - 1
    for number, (weight, bias) in enumerate(driver.layers):
        layer(weight, bias, entered, sums)
        for place in range(0 if number == last else len(bias)):
            sums[place] = leaky_relu(sums[place], np.float32(LEAK))
        entered, sums = sums, entered
    best = 0
    for action in range(1, len(driver.acceleration_m_s2)):
        best = action if entered[action] > entered[best] else best
    sign = SIGNS[best // 4]
    changing = abs(values[25] - codes[LANE] * lane_width_m) > CENTERED_M
    permitted = has_lane(codes, sign) and is_clear(values, codes, sign, driver.safety)
    return driver.acceleration_m_s2[best], sign if permitted and not changing else 0


@borrowing
def layer(
    weight: Float32Array, bias: Float32Array, entered: Float32Array, sums: Float32Array
) -> None:
    """Fill the first elements of ``sums`` with the sums of one layer of a network.

    It adds the inputs one after the other, so the result is the same on every machine, for one
    vehicle and for many; BLAS promises neither.
    """
    inputs, outputs = weight.shape
    row = 0
    for out in range(outputs):
        sums[out] = bias[out]
    while row + 4 <= inputs:
        a, b, c, d = entered[row], entered[row + 1], entered[row + 2], entered[row + 3]
        for out in range(outputs):
            sums[out] = (
                sums[out]
                + a * weight[row, out]
                + b * weight[row + 1, out]
                + c * weight[row + 2, out]
                + d * weight[row + 3, out]
            )
        row += 4
    while row < inputs:
        for out in range(outputs):
            sums[out] += entered[row] * weight[row, out]
        row += 1


def load_level_k(road: Road, level: int, folder: Path | None = None) -> LevelKNumbers:
    """Load the driver of a level, 1 or 2, of the background traffic.

    Args:
        road: The road of the traffic.
        level: The driver's level.
        folder: A run's folder with the policy; None for the shipped one.

    Raises:
        CheckpointError: the policy file is missing or damaged, or does not
            match the config in the folder.
    """
    try:
        network, config = load_run(folder or LEVELS[level])
    except DrlAvError as error:
        raise CheckpointError(
            f"The level-{level} driver of the traffic cannot be read "
            f"({str(error).removesuffix('.')}): train it again with make level_{level}, or set "
            f"traffic.level_{level}_share to 0."
        ) from error
    return level_k_numbers(network.layers, config, road)
