"""Observations of the user's choice: named groups of indicators, or an own object (ours)."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, Protocol

import gymnasium
import numpy as np
import numpy.typing as npt

from drl_av.config.schema import did_you_mean
from drl_av.driving.affordances import INDICATORS, SLOTS, ObservationScale
from drl_av.driving.mirror import Mirror, mirror_of
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError

FURTHER = ("right_lane", "left_lane", "lane_change")
"""Indicators that the paper does not have: whether a lane exists and is open, 1 or 0; the direction
of the lane change in progress, left 1, right -1, none 0."""
GROUPS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {slot: tuple(name for name in INDICATORS if name.startswith(slot)) for slot in SLOTS}
    | {"ego": INDICATORS[-3:], "lanes": FURTHER[:2], "lane_change": FURTHER[2:]}
)
"""The indicators of each group. The first seven groups are the 27 indicators of the paper."""


class ObservationFunction(Protocol):
    """An observation of the user's own: a function of the scene with an attribute ``space``."""

    @property
    def space(self) -> gymnasium.spaces.Space[Any]:
        """The gymnasium space of the observations."""

    def __call__(self, scene: Scene) -> Any:
        """The observation of a scene, which must lie in ``space``."""


class GroupObservation:
    """The indicators of some groups, scaled as in the observation of all 27.

    Raises:
        ConfigError: there is no such group, a group occurs twice, or there is none at all.
    """

    def __init__(self, groups: Sequence[str], scale: ObservationScale) -> None:
        _require_groups(groups)
        self.names = tuple(name for group in groups for name in GROUPS[group])
        """Name of each place of the observation."""
        self._scale = scale
        every = [*INDICATORS, *FURTHER]
        self._places = np.array([every.index(name) for name in self.names])
        bounds = np.append(scale.bounds, np.ones(len(FURTHER), np.float32))[self._places]
        self.space = gymnasium.spaces.Box(-bounds, bounds, dtype=np.float32)
        """A box of shape (number of indicators,), float32."""

    def __call__(self, scene: Scene) -> npt.NDArray[np.float32]:
        """The scaled indicators of a scene, in the order of ``names``."""
        affordances, change = scene.affordances, scene.lane_change
        further = (affordances.right_lane, affordances.left_lane, change.sign if change else 0)
        scaled = np.append(self._scale(affordances.vector()), np.array(further, np.float32))
        selected: npt.NDArray[np.float32] = scaled[self._places]
        return selected

    @cached_property
    def mirror(self) -> Mirror:
        """The permutations and signs that exchange left and right.

        Raises:
            ConfigError: one side has a group that the other side does not have.
        """
        try:
            return mirror_of(self.names)
        except ValueError as error:
            raise ConfigError(
                f"An observation of {', '.join(self.names)} has no mirror image: name the groups "
                "of both sides or of neither."
            ) from error


def observation_function(
    given: str | Iterable[str] | ObservationFunction, scale: ObservationScale
) -> ObservationFunction:
    """The argument ``observation`` of the environment as an object.

    Raises:
        ConfigError: it is neither groups of indicators nor a function with a ``space``.
    """
    if isinstance(given, str):
        return GroupObservation([given], scale)
    if isinstance(given, Iterable):
        return GroupObservation(list(given), scale)
    if callable(given) and isinstance(getattr(given, "space", None), gymnasium.Space):
        return given
    raise ConfigError(
        f"observation is {given!r}, but must be names of groups ({', '.join(GROUPS)}), or an "
        "object with a gymnasium space as its attribute space that is called with a scene."
    )


def require_inside(observation: Any, space: gymnasium.spaces.Space[Any]) -> None:
    """Raise ConfigError if an observation of the user's own does not lie in its space."""
    if not space.contains(observation):
        shape, kind = np.shape(observation), getattr(observation, "dtype", type(observation))
        raise ConfigError(
            f"The observation has the shape {shape} and the type {kind}, or a value out of "
            f"bounds, and does not lie in its space {space}: change one of the two."
        )


def _require_groups(groups: Sequence[str]) -> None:
    for group, number in Counter(groups).items():
        if group not in GROUPS:
            raise ConfigError(
                f"There is no group of indicators {group!r}{did_you_mean(group, GROUPS)}; "
                f"the groups are: {', '.join(GROUPS)}."
            )
        if number > 1:
            raise ConfigError(f"The group of indicators {group!r} is named {number} times.")
    if not groups:
        raise ConfigError(f"observation names no group; the groups are: {', '.join(GROUPS)}.")
