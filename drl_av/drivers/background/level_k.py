"""Level-k drivers of the traffic: level 0 follows a rule; level 1 responds best to level 0.

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
from drl_av.road.road import FloatArray, Road
from drl_av.safety.paper import Approach, lane_change_is_safe

LEVEL_1 = Path(__file__).parents[2] / "pretrained" / "level_1"
"""Folder of the shipped level-1 policy, in the layout of a run's folder."""

LEVEL_0 = np.array(
    [
        [Longitudinal.HARD_BRAKE, Longitudinal.BRAKE, Longitudinal.MAINTAIN],
        [Longitudinal.BRAKE, Longitudinal.MAINTAIN, Longitudinal.ACCELERATE],
        [Longitudinal.ACCELERATE, Longitudinal.ACCELERATE, Longitudinal.ACCELERATE],
    ]
)
"""The action of a level-0 driver. The row is the gap to the vehicle ahead (close, nominal, far),
the column is the change of this gap (it shrinks, is stable, grows)."""


def level_0(neighbors: Surroundings, config: Level0Config, ego: EgoConfig) -> Decisions:
    """Return the decisions of level-0 drivers: the actions of LEVEL_0, without lane changes."""
    distance = np.digitize(
        neighbors.gap_m[:, OWN, FRONT], (config.close_m, config.nominal_m), right=True
    )
    speed = neighbors.relative_speed_m_s[:, OWN, FRONT]
    motion = 1 + np.sign(speed).astype(np.intp) * (np.abs(speed) > config.stable_m_s)
    return Decisions(
        _accelerations(ego)[LEVEL_0[distance, motion]], np.zeros(len(speed), dtype=np.intp)
    )


class Level1:
    """The level-1 driver: the greedy policy of a network that was trained in level-0 traffic.

    ``config`` is the config of the training, which determines the observation. Unlike the learned
    drivers of the ego, the driver uses no mirror images and no margins.
    """

    def __init__(self, layers: Layers, config: Config, road: Road) -> None:
        self._layers = layers
        self.range_m = config.observation.range_m
        self._scale = ObservationScale(config.observation, config.ego.max_speed_m_s, road)
        self._acceleration_m_s2 = _accelerations(config.ego)[[a.longitudinal for a in ACTIONS]]
        self._safety = config.safety
        self._side = np.array([action.lateral.sign for action in ACTIONS])

    def __call__(self, neighbors: Surroundings) -> Decisions:
        """Return the decision with the greatest Q-value for each vehicle.

        As in its training, a vehicle requests a lane change only if rules 2 and 3 of the check
        ``paper`` permit it. It requests none during a lane change, because SUMO cannot abort one.
        """
        _, values = forward(self._layers, self._scale(neighbors.vectors()))
        best = values.argmax(axis=1)
        side = np.where(neighbors.under_way, 0, self._side[best])
        for sign, lane in ((1, LEFT), (-1, RIGHT)):
            side[(side == sign) & ~self._is_clear(neighbors, lane)] = 0
        return Decisions(self._acceleration_m_s2[best], side)

    def _is_clear(self, neighbors: Surroundings, lane: int) -> npt.NDArray[np.bool_]:
        """Return whether rules 2 and 3 of ``paper`` permit to enter ``lane``; shape (R,)."""
        gap_m, speed_m_s = neighbors.gap_m, neighbors.relative_speed_m_s
        clear: npt.NDArray[np.bool_] = neighbors.has_lane[:, lane] & lane_change_is_safe(
            Approach(gap_m[:, OWN, FRONT], -speed_m_s[:, OWN, FRONT]),
            Approach(gap_m[:, lane, FRONT], -speed_m_s[:, lane, FRONT]),
            Approach(gap_m[:, lane, REAR], speed_m_s[:, lane, REAR]),
            self._safety,
        )
        return clear


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


def _accelerations(ego: EgoConfig) -> FloatArray:
    return np.array([longitudinal.acceleration_m_s2(ego) for longitudinal in Longitudinal])
