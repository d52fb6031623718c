"""What a safety check is: a function that judges a proposed action in a scene."""

from collections.abc import Callable
from enum import Flag, auto
from functools import cache
from typing import NamedTuple

from drl_av.driving.actions import Action
from drl_av.driving.scene import Scene


class Rule(Flag):
    """The rules of Sec. III that changed a decision."""

    NONE = 0
    IN_LANE = auto()
    """Rule 1: too close to the vehicle ahead, and faster."""
    OFF_ROAD = auto()
    """Rule 2: no such lane."""
    LANE_CHANGE = auto()
    """Rule 3: a gap that the lane change needs is too small."""

    @cache
    def __str__(self) -> str:
        words = [str(rule.name).lower() for rule in Rule if rule in self]
        return "+".join(words) or "none"


class Verdict(NamedTuple):
    """The action that will be executed, and the rules that changed it, if any."""

    action: Action
    rule: Rule


SafetyCheck = Callable[[Scene, Action], Verdict]
"""Judges a proposed action in a scene."""


def permit_all(scene: Scene, proposed: Action) -> Verdict:
    """No check: every decision is executed as proposed (the paper's ablation)."""
    return Verdict(proposed, Rule.NONE)
