"""Rule-based drivers: those of Sec. IV-C of the paper, MOBIL, a gap rule, and SUMO itself."""

import numpy as np
import numpy.typing as npt

from drl_av.compiled import numbers
from drl_av.config import EgoConfig, MobilConfig, SafetyConfig, SimulationConfig
from drl_av.config.traffic import CONGESTED_M_S
from drl_av.drivers.driver import Driver
from drl_av.drivers.rules import idm_number, rule_action
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal, ego_numbers, toward
from drl_av.driving.affordances import Neighbor
from drl_av.driving.car_following import MobilNumbers
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.random_streams import Stream, generator
from drl_av.road.snapshot import EGO
from drl_av.safety.paper import SafetyNumbers
from drl_av.simulation.vehicle_calls import EgoModel


class IdmDriver(Driver):
    """The driver ``idm``: follows the paper's IDM, and never changes lanes."""

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Keep the lane, with the longitudinal action of the paper's IDM."""
        values, codes, *_ = scene.indicators
        return ACTIONS[idm_number(values, codes, self._config)]


class IdmSumoDriver(IdmDriver):
    """The driver ``idm-sumo``: ``idm``, plus the lane changes that SUMO's SL2015 would make."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the IDM's longitudinal action, with the lane change that SUMO's model demands.

        A lane change in progress is always completed.
        """
        sign = scene.snapshot.sumo_lane_change if scene.lane_change is None else 0
        return super().act(scene, observation)._replace(lateral=toward(sign))


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


class MobilDriver(Driver):
    """The driver ``idm-mobil``: follows the paper's IDM in its lane, and changes lanes by MOBIL.

    It never aborts a lane change.
    """

    headway_s = 0.0

    def __init__(self, safety: SafetyConfig, ego: EgoConfig, mobil: MobilConfig) -> None:
        self._numbers = (
            numbers(SafetyNumbers, safety),
            ego_numbers(ego, SimulationConfig()),
            numbers(MobilNumbers, mobil),
        )

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the longitudinal action, with a lane change if MOBIL demands one."""
        values, codes, *_ = scene.indicators
        now = scene.lane_change is not None, float(scene.snapshot.length_m[EGO]), self.headway_s
        number: int = rule_action.fast(values, codes, *now, *self._numbers)
        return ACTIONS[number]


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
        self.headway_s = headway_s


class NoPassingOnTheRight:
    """Wraps a driver so that it does not pass vehicles on their right side.

    The driver stays behind the vehicle ahead in the left lane as if that vehicle were in its own
    lane. It changes to the right only if it may pass the vehicle ahead in its own lane. It may pass
    a vehicle that is beside the ego (gap 0) or not faster than 60 km/h.
    """

    def __init__(self, driver: Driver, ego: EgoConfig) -> None:
        self._driver, self._ego = driver, ego

    def start(self, seed: int) -> None:
        """Prepare the inner driver for an episode."""
        self._driver.start(seed)

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the inner driver's action, changed where it would pass on the right.

        A forbidden change to the right becomes KEEP. If the ego must not pass the vehicle ahead in
        the left lane, the inner driver decides a second time, as if that vehicle were in the ego's
        lane. The ego then takes the smaller acceleration of the two decisions.
        """
        action = self._driver.act(scene, observation)
        lateral, longitudinal = action
        if lateral is Lateral.RIGHT and self._must_not_pass(scene, scene.affordances.own_front):
            lateral = Lateral.KEEP
        left = scene.affordances.left_front
        if self._must_not_pass(scene, left):
            affordances = scene.affordances._replace(own_front=left)
            behind = self._driver.act(scene._replace(affordances=affordances), observation)
            longitudinal = min(longitudinal, behind.longitudinal, key=self._acceleration_m_s2)
        return Action(lateral, longitudinal)

    def _acceleration_m_s2(self, longitudinal: Longitudinal) -> float:
        return longitudinal.acceleration_m_s2(self._ego)

    def _must_not_pass(self, scene: Scene, other: Neighbor | None) -> bool:
        if other is None or other.gap_m <= 0.0:
            return False
        return scene.affordances.ego_speed_m_s + other.relative_speed_m_s > CONGESTED_M_S


TUNED = EgoModel(headway_s=0.8, assertiveness=1.5, speed_gain=5.0, overtake_right=True)
"""The parameters of ``sumo-tuned`` (ours): those with the highest speed in a search. The search is
not part of this project."""


def require_world(driver: object, world: str) -> None:
    """Raise ConfigError if a driver is SUMO's, or asks it, and the world is not SUMO."""
    if world != "sumo" and isinstance(driver, SumoDriver | IdmSumoDriver):
        raise ConfigError(
            "SUMO drives or changes lanes for the drivers sumo, sumo-tuned and idm-sumo, but the "
            f"world is the {world}: evaluate them in SUMO."
        )


class SumoDriver(Driver):
    """Lets SUMO's IDM and lane-change model SL2015 drive the ego, with the parameters ``model``.

    For this driver ``rollout`` calls ``HighwayEnv.hand_over`` instead of ``act``; the environment
    then ignores actions.
    """

    def __init__(self, model: EgoModel) -> None:
        self.model = model

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Raise ConfigError: SUMO chooses no action."""
        raise ConfigError(
            "SUMO itself drives the ego with this driver, which therefore has no actions: give "
            "its name to drl_av.evaluate, or call env.unwrapped.hand_over(driver.model) after each "
            "reset and pass any action to step."
        )
