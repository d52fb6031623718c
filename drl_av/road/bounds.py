"""Bounds of the numbers in a scenario's description, and the check of a number against them."""

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any

from drl_av.errors import ScenarioError

Bounds = tuple[float, float]
"""The smallest and the largest allowed value."""
LENGTHS_M: Bounds = (1.0, 25.0)
WIDTHS_M: Bounds = (0.5, 5.0)
"""Bounds of the length and the width of each vehicle of a scenario."""


def check_numbers(
    described: Any, prefix: str, bounds: Mapping[str, Bounds] = MappingProxyType({})
) -> None:
    """Check each field that has bounds, and convert whole numbers in float fields to float.

    ``described`` is a dataclass object, changed in place. ``bounds`` holds bounds by field name.
    The bounds of all other fields are ``low`` and ``high`` of their metadata.

    Raises:
        ScenarioError: a number has a wrong type or is out of bounds; the message begins with
            ``prefix``.
    """
    for item in fields(described):
        stated = (item.metadata.get("low"), item.metadata.get("high"))
        low, high = bounds.get(item.name, stated)
        if low is None or high is None:
            continue
        value = getattr(described, item.name)
        whole = item.type is int
        if type(value) not in ((int,) if whole else (int, float)) or not low <= value <= high:
            kind = "a whole number" if whole else "a number"
            raise ScenarioError(
                f"{prefix}{item.name} is {value!r}, but must be {kind} from {low:g} to {high:g}."
            )
        object.__setattr__(described, item.name, value if whole else float(value))
