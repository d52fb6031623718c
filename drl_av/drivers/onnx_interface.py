"""Descriptions of an exported driver's inputs and outputs, for its file, the help and the docs."""

import json
from typing import NamedTuple

from drl_av.config import Config
from drl_av.drivers.learned import Margins
from drl_av.driving.actions import ACTIONS
from drl_av.driving.affordances import INDICATORS, SLOTS


class Port(NamedTuple):
    """An input or output of an exported driver."""

    name: str
    dtype: str
    """The numpy name of the element type."""
    columns: int | None
    """The shape is (rows, columns), or (rows,) if ``columns`` is None. Each row is one scene."""
    meaning: str

    @property
    def shape(self) -> list[str | int]:
        """The shape; a dimension of any size is given by its name."""
        return ["rows"] if self.columns is None else ["rows", self.columns]


_STATES = "d_x, v_x, d_y, v_y"
INPUTS = (
    Port(
        "indicators",
        "float64",
        len(INDICATORS),
        "the affordance indicators in SI units, unscaled, in the order of info['indicators']: "
        f"{_STATES} for each of {', '.join(SLOTS)}, then {', '.join(INDICATORS[-3:])}",
    ),
    Port(
        "lane_change",
        "bool",
        None,
        "whether a lane change of the ego is in progress: from the decision that starts it until "
        "the ego is on the centre of a lane again",
    ),
)
OUTPUTS = (
    Port(
        "action",
        "int64",
        None,
        "number of the action with the greatest Q-value, 4 * lateral (keep, right, left) + "
        "longitudinal (maintain, accelerate, brake, hard brake); each Q-value first loses the "
        "margin of its action",
    ),
    Port("q", "float32", len(ACTIONS), "Q-values of the actions, without the margins"),
)
INSIDE = (
    "The file contains the scaling and clipping of the indicators, all networks and their mean, "
    "the mean over the scene and its mirror image if the driver was trained so, and the margins "
    "for starting and aborting lane changes and for accelerations. It has no safety check. One "
    "call is one decision, for the next second."
)
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


def described() -> str:
    """Return one paragraph on the inputs, the outputs and the content of an exported driver."""
    words = [
        f"{kind} {port.name}, {port.dtype} ({', '.join(map(str, port.shape))}): {port.meaning}."
        for kind, ports in (("Input", INPUTS), ("Output", OUTPUTS))
        for port in ports
    ]
    return " ".join([*words, INSIDE])


def metadata(config: Config) -> dict[str, str]:
    """Return the metadata of an exported driver: its config, indicators, actions and margins.

    ``indicators`` and ``actions`` are JSON lists, ``config`` is TOML, and each margin is a number.
    """
    indicators = [{"name": name, "meaning": indicator_meaning(name)} for name in INDICATORS]
    return {
        "config": config.to_toml(),
        "indicators": json.dumps(indicators),
        "actions": json.dumps([str(action) for action in ACTIONS]),
        **{
            f"{name}_margin": repr(margin)
            for name, margin in Margins.of(config.learning)._asdict().items()
        },
    }
