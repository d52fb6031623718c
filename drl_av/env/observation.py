"""Observations that the user chooses: named groups of indicators, or the user's object (ours)."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from types import MappingProxyType
from typing import Any, Protocol

import gymnasium
import numpy as np

from drl_av.arrays import Float32Array, FloatArray, IntArray
from drl_av.config import ObservationConfig
from drl_av.config.functions import require_function
from drl_av.config.section import did_you_mean
from drl_av.driving.affordances import (
    ALLOWED,
    CHANGES,
    FRONT,
    INDICATORS,
    LANE,
    LEFT_LANE,
    RIGHT_LANE,
    ROUTE_INDICATORS,
    ROUTE_SCALE_M,
    SLOTS,
    WITHIN,
)
from drl_av.driving.observation_scale import ObservationScale
from drl_av.driving.scene import Scene, unwritable
from drl_av.driving.wide_observation import MOST, WIDE_NAMES, WIDE_SIZE, observe_wide
from drl_av.errors import ConfigError

FURTHER = ("right_lane", "left_lane", "lane_change", *ROUTE_INDICATORS, "allowed_speed")
"""Indicators that the paper does not have. ``right_lane`` and ``left_lane`` are 1 if that lane
exists and may be entered, and otherwise 0. ``lane_change`` is the lane change in progress: +1 left,
-1 right, 0 none. ``ROUTE_INDICATORS`` describes the next three. ``allowed_speed`` is the speed that
the speed limits here and ahead allow, divided by the ego's largest speed, at most 1."""
GROUPS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {slot: tuple(name for name in INDICATORS if name.startswith(slot)) for slot in SLOTS}
    | {"ego": INDICATORS[-3:], "lanes": FURTHER[:2], "lane_change": FURTHER[2:3]}
    | {"lane_end": FURTHER[3:4], "way": FURTHER[4:6]}
    | {"speed_limit": FURTHER[6:]}
)
"""The names of the indicators in each group; the first seven groups are those of the paper."""


def default_groups(config: ObservationConfig) -> tuple[str, ...]:
    """Return the groups that the observation has with these settings if the user names none."""
    paper = tuple(GROUPS)[:7]
    return (*paper, "lane_end", "way") if config.way else paper


class ObservationFunction(Protocol):
    """An observation that the user defines: a function of the scene with an attribute ``space``."""

    @property
    def space(self) -> gymnasium.spaces.Space[Any]:
        """The gymnasium space that contains all observations."""

    def __call__(self, scene: Scene) -> Any:
        """Return the observation of a scene, which must lie in ``space``."""


class GroupObservation:
    """An observation of the indicators of some groups, scaled as in the default observation.

    Raises:
        ConfigError: there is no such group, a group occurs twice, or no group is given.
    """

    def __init__(self, groups: Sequence[str], scale: ObservationScale) -> None:
        for group in groups:
            if not isinstance(group, str) or group not in GROUPS:
                raise ConfigError(
                    f"There is no group of indicators {group!r}{did_you_mean(group, GROUPS)}; "
                    f"the groups are: {WIDE} alone, {', '.join(GROUPS)}."
                )
        for group, number in Counter(groups).items():
            if number > 1:
                raise ConfigError(f"The group of indicators {group!r} is named {number} times.")
        if not groups:
            raise ConfigError(f"observation names no group; the groups are: {', '.join(GROUPS)}.")
        self.groups = groups
        self.names = tuple(name for group in groups for name in GROUPS[group])
        """Name of each element of the observation."""
        self._scale = scale
        every = [*INDICATORS, *FURTHER]
        self._places = np.array([every.index(name) for name in self.names])
        bounds = np.append(scale.bounds, np.ones(len(FURTHER), np.float32))[self._places]
        self.space = gymnasium.spaces.Box(-bounds, bounds, dtype=np.float32)
        """A Box of shape (number of indicators,), float32."""

    def __call__(self, scene: Scene) -> Float32Array:
        """Return the scaled indicators of a scene in the order of ``names``."""
        (values, codes, (_, _, barriers), *_), (origin, target) = scene.indicators, scene.lanes
        scaled, side = self._scale(values[:27]), np.array([target - origin])
        found = self.of_worlds(scaled[None], values[None], codes[None], side, barriers)
        return found.reshape(-1)

    def of_worlds(
        self,
        scaled: Float32Array,
        values: FloatArray,
        codes: IntArray,
        lane_changes: IntArray,
        barriers: FloatArray,
    ) -> Float32Array:
        """Return what the function returns for a scene, for many at once.

        Args:
            scaled: The 27 indicators as ``ObservationScale`` scales them, shape (worlds, 27).
            values: Those of ``Indicators``, shape (worlds, 30).
            codes: Likewise, shape (worlds, 10).
            lane_changes: The direction of the lane change in progress or 0, shape (worlds,).
            barriers: Those of the road, shape (barriers, 3).
        """
        if self.names == INDICATORS:
            return scaled.copy()
        scale = self._scale
        center_m = codes[:, LANE, np.newaxis] * scale.road.lane_width_m
        ahead_m = barriers[:, 0] - values[:, FRONT, np.newaxis]
        is_end = (ahead_m >= 0) & (barriers[:, 1] < center_m) & (center_m < barriers[:, 2])
        ends_m = np.where(is_end, ahead_m, scale.range_m).min(axis=1, initial=scale.range_m)
        further = (
            *(codes[:, RIGHT_LANE], codes[:, LEFT_LANE], lane_changes, ends_m / scale.range_m),
            codes[:, CHANGES] / max(scale.lanes - 1, 1),
            np.minimum(values[:, WITHIN] / ROUTE_SCALE_M, 1.0),
            np.minimum(values[:, ALLOWED] / scale.max_speed_m_s, 1.0),
        )
        every = np.hstack((scaled, np.stack(further, axis=1).astype(np.float32)))
        return every[:, self._places]


WIDE = "wide"
"""The name of ``WideObservation``."""


class WideObservation:
    """The observation of the driver that was trained at scale; ``WIDE_NAMES`` describes it (ours).

    It is chosen by the name ``wide`` alone, instead of groups of indicators.
    """

    groups = WIDE
    names = WIDE_NAMES
    """Name of each element of the observation."""

    def __init__(self, scale: ObservationScale) -> None:
        self._see = scale.road, scale.range_m, scale.max_speed_m_s
        self.space = gymnasium.spaces.Box(-MOST, MOST, (WIDE_SIZE,), np.float32)

    def __call__(self, scene: Scene) -> Float32Array:
        """Return the wide observation of a scene."""
        return observe_wide(scene.snapshot, *self._see, scene.lanes)


class OwnObservation:
    """The user's observation function; each of its observations must lie in its space."""

    def __init__(self, observe: ObservationFunction) -> None:
        self._observe, self.space = observe, observe.space

    def __call__(self, scene: Scene) -> Any:
        """Return the user's observation; raise ConfigError if it does not lie in its space."""
        with unwritable(self._observe, scene):
            observation = self._observe(scene)
        try:
            if self.space.contains(observation):
                if isinstance(self.space, gymnasium.spaces.Box):
                    return np.array(observation, self.space.dtype)
                return deepcopy(observation)  # the function may fill the same array again
            shape = np.shape(observation)
        except ValueError:  # a ragged sequence
            shape = "of no array"
        kind = getattr(observation, "dtype", type(observation))
        raise ConfigError(
            f"The observation has the shape {shape} and the type {kind}, or a value out of "
            f"bounds, and does not lie in its space {self.space}: change one of the two."
        )


def observation_function(
    given: str | Iterable[str] | ObservationFunction, scale: ObservationScale
) -> ObservationFunction:
    """Convert the argument ``observation`` of the environment to a callable object.

    Raises:
        ConfigError: ``given`` does not name known groups of indicators, and is not a function of a
            scene with an attribute ``space`` either.
    """
    if isinstance(given, str) and given == WIDE:
        return WideObservation(scale)
    if isinstance(given, str):
        return GroupObservation([given], scale)
    if isinstance(given, Iterable):
        if not isinstance(given, set | frozenset):
            return GroupObservation(list(given), scale)
    elif not isinstance(given, type) and isinstance(getattr(given, "space", None), gymnasium.Space):
        require_function(given, "observation", "scene")
        return OwnObservation(given)
    raise ConfigError(
        f"observation is {given!r}, but must be {WIDE}, names of groups ({', '.join(GROUPS)}) in "
        "a list, or an object with a gymnasium space as its attribute space that is called with a "
        "scene."
    )
