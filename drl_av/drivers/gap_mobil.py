"""The strong rule-based driver ``gap-mobil``: a constant time-gap law and MOBIL (ours)."""

from drl_av.config import EgoConfig, MobilConfig, SafetyConfig
from drl_av.drivers.mobil import MobilDriver
from drl_av.driving.actions import Longitudinal, nearest_action
from drl_av.driving.affordances import Affordances
from drl_av.driving.car_following import time_gap_acceleration


class GapMobilDriver(MobilDriver):
    """Keeps a constant time gap of ``headway_s`` to the vehicle ahead, and changes lanes by MOBIL.

    The driver is deterministic. No parameter is tuned to any traffic: the standstill gap and the
    gain of the time-gap law are those of the adaptive cruise control
    (``ego.longitudinal_reference`` = ``acc``).
    """

    def __init__(
        self, safety: SafetyConfig, ego: EgoConfig, mobil: MobilConfig, headway_s: float
    ) -> None:
        super().__init__(safety, ego, mobil)
        self._headway_s = headway_s

    def longitudinal(self, affordances: Affordances) -> Longitudinal:
        """Return the action whose acceleration is nearest to that of the time-gap law.

        If no vehicle ahead is in range, the action is to accelerate.
        """
        front = affordances.own_front
        if front is None:
            return Longitudinal.ACCELERATE
        wanted = time_gap_acceleration(
            affordances.ego_speed_m_s,
            front.gap_m,
            -front.relative_speed_m_s,
            self._headway_s,
            self._ego,
        )
        return nearest_action(wanted, self._ego)
