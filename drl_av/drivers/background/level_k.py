"""Level-k drivers: level 0 follows a rule, level 1 is the best response to level-0 traffic.

Source: Li, Oyler, Zhang, Yildiz, Kolmanovsky and Girard 2017. The rule of level 0 is that of Albaba
and Yildiz 2020. The accelerations are those of the ego's actions.
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from drl_av.config import Config, EgoConfig, Level0Config
from drl_av.drivers.background.surroundings import FRONT, LEFT, OWN, REAR, RIGHT, Surroundings
from drl_av.drivers.driver import Decisions
from drl_av.drivers.network import Layers, forward
from drl_av.drivers.policy_file import load_run
from drl_av.driving.actions import ACTIONS, Longitudinal
from drl_av.driving.affordances import ObservationScale
from drl_av.errors import CheckpointError, DrlAvError
from drl_av.safety.paper import Approach, lane_change_is_safe
from drl_av.traffic.road import FloatArray, Road

LEVEL_1 = Path(__file__).parents[2] / "pretrained" / "level_1"
"""Folder of the shipped level-1 policy; laid out as a run's."""

LEVEL_0 = np.array(
    [
        [Longitudinal.HARD_BRAKE, Longitudinal.BRAKE, Longitudinal.MAINTAIN],
        [Longitudinal.BRAKE, Longitudinal.MAINTAIN, Longitudinal.ACCELERATE],
        [Longitudinal.ACCELERATE, Longitudinal.ACCELERATE, Longitudinal.ACCELERATE],
    ]
)
"""Level-0 actions by the vehicle ahead; rows: close, nominal, far; columns: approaching, stable,
moving away."""


def level_0(neighbors: Surroundings, config: Level0Config, ego: EgoConfig) -> Decisions:
    """Decisions of level-0 drivers: they keep their lanes and observe the vehicle ahead only."""
    distance = np.digitize(
        neighbors.gap_m[:, OWN, FRONT], (config.close_m, config.nominal_m), right=True
    )
    speed = neighbors.relative_speed_m_s[:, OWN, FRONT]
    motion = 1 + np.sign(speed).astype(np.intp) * (np.abs(speed) > config.stable_m_s)
    return Decisions(
        _accelerations(ego)[LEVEL_0[distance, motion]], np.zeros(len(speed), dtype=np.intp)
    )


class Level1:
    """A level-1 driver: a greedy policy that was trained in traffic of level-0 drivers, in numpy.

    It has the observation of the ego in that training, whose config is ``config``. It uses the
    network alone, without a mirror or a margin for lane changes.
    """

    def __init__(self, layers: Layers, config: Config, road: Road) -> None:
        self._layers = layers
        self.range_m = config.observation.range_m
        self._scale = ObservationScale(config.observation, config.ego.max_speed_m_s, road)
        self._acceleration_m_s2 = _accelerations(config.ego)[[a.longitudinal for a in ACTIONS]]
        self._safety = config.safety
        self._side = np.array([action.lateral.sign for action in ACTIONS])

    def __call__(self, neighbors: Surroundings) -> Decisions:
        """The action of the greatest value for each vehicle; the first of several equal ones.

        It requests a lane change only if rules 2 and 3 of the safety check permit it, as in the
        training of the policy. It never does so during a lane change, which SUMO cannot abort.
        """
        _, values = forward(self._layers, self._scale(neighbors.vectors()))
        best = values.argmax(axis=1)
        side = np.where(neighbors.under_way, 0, self._side[best])
        for sign, lane in ((1, LEFT), (-1, RIGHT)):
            side[(side == sign) & ~self._is_clear(neighbors, lane)] = 0
        return Decisions(self._acceleration_m_s2[best], side)

    def _is_clear(self, neighbors: Surroundings, lane: int) -> npt.NDArray[np.bool_]:
        """Rules 2 and 3: the lane exists, and the gaps are large enough for a lane change."""
        gap_m, speed_m_s = neighbors.gap_m, neighbors.relative_speed_m_s
        clear: npt.NDArray[np.bool_] = neighbors.has_lane[:, lane] & lane_change_is_safe(
            Approach(gap_m[:, OWN, FRONT], -speed_m_s[:, OWN, FRONT]),
            Approach(gap_m[:, lane, FRONT], -speed_m_s[:, lane, FRONT]),
            Approach(gap_m[:, lane, REAR], speed_m_s[:, lane, REAR]),
            self._safety,
        )
        return clear


def load_level_1(road: Road, folder: Path = LEVEL_1) -> Level1:
    """The level-1 driver of the background traffic, from the policy in a run's folder.

    Raises:
        CheckpointError: the policy is missing or damaged, does not hold exactly one network, or
            does not belong to the config in the folder.
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


def _accelerations(ego: EgoConfig) -> FloatArray:
    return np.array([longitudinal.acceleration_m_s2(ego) for longitudinal in Longitudinal])
