"""The kinds of scenarios by name.

To add a kind, write its file and add a line to ``ROAD_TYPES``, from which the help of the command
line and the docs are generated.
"""

from drl_av.errors import ScenarioError
from drl_av.scenarios.highways import EXIT, MERGE, RAMP_TO_RAMP, STRAIGHT
from drl_av.scenarios.imported.description import IMPORTED
from drl_av.scenarios.layout import RoadType
from drl_av.scenarios.loop import LOOP
from drl_av.scenarios.road_description import RoadDescription

ROAD_TYPES: dict[str, RoadType] = {
    "loop": LOOP,
    "straight": STRAIGHT,
    "merge": MERGE,
    "exit": EXIT,
    "ramp_to_ramp": RAMP_TO_RAMP,
    "imported": IMPORTED,
}


def road_type_name(description: RoadDescription) -> str:
    """Return the name of the kind of scenario to which a description belongs.

    Raises:
        ScenarioError: no kind has a description of this class.
    """
    for name, kind in ROAD_TYPES.items():
        if type(description) is kind.description:
            return name
    raise ScenarioError(
        f"No kind of scenario is described by a {type(description).__name__}: add its kind to "
        "drl_av.scenarios.road_types.ROAD_TYPES."
    )


def road_type_of(description: RoadDescription) -> RoadType:
    """Return the kind of scenario to which a description belongs.

    Raises:
        ScenarioError: no kind has a description of this class.
    """
    return ROAD_TYPES[road_type_name(description)]


def stated_road_type(description: RoadDescription) -> str:
    """Return the TOML line that names the kind; "" for a loop, whose file has no such line."""
    name = road_type_name(description)
    return "" if name == "loop" else f'kind = "{name}"\n'
