"""The kinds of scenarios by name.

To add a kind, write its file and add a line to ``KINDS``; the help of the command line and the docs
are made from it.
"""

from typing import Any

from drl_av.errors import ScenarioError
from drl_av.traffic.circular import LOOP
from drl_av.traffic.kind import ScenarioKind
from drl_av.traffic.merge import MERGE
from drl_av.traffic.straight import STRAIGHT

__all__ = ["KINDS", "ScenarioKind", "kind_of", "stated_kind"]

KINDS: dict[str, ScenarioKind] = {"loop": LOOP, "straight": STRAIGHT, "merge": MERGE}


def kind_name(description: Any) -> str:
    """The name of the kind of scenario that a description describes; raises ScenarioError."""
    for name, kind in KINDS.items():
        if type(description) is kind.description:
            return name
    raise ScenarioError(
        f"No kind of scenario is described by a {type(description).__name__}: add its kind to "
        "drl_av.traffic.kinds.KINDS."
    )


def kind_of(description: Any) -> ScenarioKind:
    """The kind of scenario that a description describes; raises ScenarioError."""
    return KINDS[kind_name(description)]


def stated_kind(description: Any) -> str:
    """The line of TOML that names the kind; empty for a loop, whose files have no such line."""
    name = kind_name(description)
    return "" if name == "loop" else f'kind = "{name}"\n'
