"""The kinds of scenarios by name.

To add a kind, write its file and add a line to ``KINDS``, from which the help of the command line
and the docs are generated.
"""

from typing import Any

from drl_av.errors import ScenarioError
from drl_av.traffic.exit import EXIT
from drl_av.traffic.imported import IMPORTED
from drl_av.traffic.kind import ScenarioKind
from drl_av.traffic.loop import LOOP
from drl_av.traffic.merge import MERGE
from drl_av.traffic.ramp_to_ramp import RAMP_TO_RAMP
from drl_av.traffic.straight import STRAIGHT

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
        "drl_av.traffic.kinds.KINDS."
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
