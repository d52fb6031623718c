"""The kinds of scenarios by name.

To add a kind, write its file and add a line to ``KINDS``, from which the help of the command line
and the docs are generated.
"""

from typing import Any

from drl_av.errors import ScenarioError
from drl_av.scenarios.highways import EXIT, MERGE, RAMP_TO_RAMP, STRAIGHT
from drl_av.scenarios.imported.description import IMPORTED
from drl_av.scenarios.layout import ScenarioKind
from drl_av.scenarios.loop import LOOP

KINDS: dict[str, ScenarioKind] = {
    "loop": LOOP,
    "straight": STRAIGHT,
    "merge": MERGE,
    "exit": EXIT,
    "ramp_to_ramp": RAMP_TO_RAMP,
    "imported": IMPORTED,
}


def kind_name(description: Any) -> str:
    """Return the name of the kind of scenario to which a description belongs.

    Raises:
        ScenarioError: no kind has a description of this class.
    """
    for name, kind in KINDS.items():
        if type(description) is kind.description:
            return name
    raise ScenarioError(
        f"No kind of scenario is described by a {type(description).__name__}: add its kind to "
        "drl_av.scenarios.road_types.KINDS."
    )


def kind_of(description: Any) -> ScenarioKind:
    """Return the kind of scenario to which a description belongs.

    Raises:
        ScenarioError: no kind has a description of this class.
    """
    return KINDS[kind_name(description)]


def stated_kind(description: Any) -> str:
    """Return the TOML line that names the kind; "" for a loop, whose file has no such line."""
    name = kind_name(description)
    return "" if name == "loop" else f'kind = "{name}"\n'
