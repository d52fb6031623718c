"""Level-k drivers of the traffic: level 0 follows a rule; level 1 responds best to level 0.

Source: Li, Oyler, Zhang, Yildiz, Kolmanovsky and Girard 2017. The rule of level 0 is that of Albaba
and Yildiz 2020. The accelerations are those of the ego's actions.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.compiled import compiled, numbers
from drl_av.config import Config, Level0Config
from drl_av.drivers.driver import Decisions
from drl_av.drivers.network import Layers, forward
from drl_av.drivers.policy_file import load_run
from drl_av.driving.actions import ACCELERATE, ACTIONS, BRAKE, HARD_BRAKE, MAINTAIN, SIGNS
from drl_av.driving.affordances import CODES, LANE, VALUES, IntArray, gap_in, has_lane, indicators
from drl_av.driving.observation_scale import ObservationScale, scale_into
from drl_av.errors import CheckpointError, DrlAvError
from drl_av.road.road import CENTERED_M, FloatArray, Road
from drl_av.road.road_numbers import RoadNumbers, road_numbers
from drl_av.road.snapshot import Snapshot
from drl_av.safety.paper import SafetyNumbers, is_clear

LEVEL_1 = Path(__file__).parents[2] / "pretrained" / "level_1"
"""Folder of the shipped level-1 policy, in the layout of a run's folder."""

LEVEL_0 = (
    *(HARD_BRAKE, BRAKE, MAINTAIN),
    *(BRAKE, MAINTAIN, ACCELERATE),
    *(ACCELERATE, ACCELERATE, ACCELERATE),
)
"""The action of a level-0 driver. The row is the gap to the vehicle ahead (close, nominal, far),
the column is the change of this gap (it shrinks, is stable, grows)."""


class Level0Numbers(NamedTuple):
    """The settings of the section ``level_0``, for compiled functions."""

    close_m: float
    nominal_m: float
    stable_m_s: float


def level_0(values: FloatArray, codes: IntArray, config: Level0Config | Level0Numbers) -> int:
    """Return the number of the longitudinal action of a level-0 driver, by the table LEVEL_0.

    ``values`` and ``codes`` are those of ``indicators``. The driver makes no lane changes.
    """
    gap_m, faster_m_s = gap_in(values, codes, 0), values[1]
    distance = 0 if gap_m <= config.close_m else 1 if gap_m <= config.nominal_m else 2
    motion = 1
    if abs(faster_m_s) > config.stable_m_s:
        motion = 2 if faster_m_s > 0.0 else 0
    return LEVEL_0[3 * distance + motion]


class Level1:
    """The level-1 driver: the greedy policy of a network that was trained in level-0 traffic.

    ``config`` is the config of the training, which determines the observation. Unlike the learned
    drivers of the ego, the driver uses no mirror images and no margins.
    """

    def __init__(self, layers: Layers, config: Config, road: Road) -> None:
        self._layers = layers
        self.range_m = config.observation.range_m
        scale = ObservationScale(config.observation, config.ego.max_speed_m_s, road)
        self._look = road_numbers(road), self.range_m, scale.offset, scale.scale, scale.bounds
        self._acceleration_m_s2 = np.array(
            [action.longitudinal.acceleration_m_s2(config.ego) for action in ACTIONS]
        )
        self._safety = numbers(SafetyNumbers, config.safety)

    def __call__(self, snapshot: Snapshot, rows: npt.NDArray[np.intp]) -> Decisions:
        """Return the decision with the greatest Q-value for each vehicle, by its row.

        As in its training, a vehicle requests a lane change only if rules 2 and 3 of the check
        ``paper`` permit it. It requests none during a lane change, because SUMO cannot abort one.
        """
        n = len(rows)
        values, codes = np.empty((n, VALUES)), np.empty((n, CODES), np.int64)
        observations = np.empty((n, 27), np.float32)
        look.fast(*snapshot.arrays, *self._look, rows, values, codes, observations)
        _, q_values = forward(self._layers, observations)
        best, side = q_values.argmax(axis=1), np.empty(n, np.intp)
        lane_width_m = self._look[0].lane_width_m
        permit_sides.fast(values, codes, best, lane_width_m, self._safety, side)
        return Decisions(self._acceleration_m_s2[best], side)


@compiled
def look(
    s_m: FloatArray,
    y_m: FloatArray,
    speed_m_s: FloatArray,
    lateral_speed_m_s: FloatArray,
    length_m: FloatArray,
    width_m: FloatArray,
    road: RoadNumbers,
    range_m: float,
    offset: FloatArray,
    scale: FloatArray,
    bounds: npt.NDArray[np.float32],
    rows: IntArray,
    values: FloatArray,
    codes: IntArray,
    observations: npt.NDArray[np.float32],
) -> None:
    """Compute the indicators and the observation of each vehicle in ``rows``, shape (R,).

    The first six arrays are those of a snapshot; ``offset``, ``scale`` and ``bounds`` are those of
    ``ObservationScale``. The function fills the last three arrays, of R rows.
    """
    state = s_m, y_m, speed_m_s, lateral_speed_m_s, length_m, width_m
    for one in range(len(rows)):
        indicators(*state, road, range_m, values[one], codes[one], rows[one])
        scale_into(values[one], offset, scale, bounds, observations[one])


@compiled
def permit_sides(
    values: FloatArray,
    codes: IntArray,
    best: IntArray,
    lane_width_m: float,
    safety: SafetyNumbers,
    side: IntArray,
) -> None:
    """Set ``side`` to the permitted lane change of each vehicle, whose best action is ``best``."""
    for one in range(len(best)):
        sign, its, code = SIGNS[best[one] // 4], values[one], codes[one]
        changing = abs(its[25] - code[LANE] * lane_width_m) > CENTERED_M
        permitted = has_lane(code, sign) and is_clear(its, code, sign, safety)
        side[one] = sign if permitted and not changing else 0


def load_level_1(road: Road, folder: Path = LEVEL_1) -> Level1:
    """Load the level-1 driver of the background traffic from the policy in a run's folder.

    Raises:
        CheckpointError: the policy file is missing or damaged, holds several networks, or does not
            match the config in the folder.
    """
    try:
        networks, config = load_run(folder)
        if len(networks) > 1:
            raise CheckpointError(f"{folder} holds {len(networks)} networks, not one")
    except DrlAvError as error:
        raise CheckpointError(
            f"The level-1 driver of the traffic cannot be read ({str(error).removesuffix('.')}): "
            "train it again with make level_1, or set traffic.level_1_share to 0."
        ) from error
    return Level1(networks[0].layers, config, road)
