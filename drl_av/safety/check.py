"""The interface of a safety check, a function from a scene and a proposed action to a verdict."""

from collections.abc import Callable
from contextlib import suppress
from enum import Flag, auto
from functools import cache
from typing import NamedTuple

import numpy as np

from drl_av.arrays import IntArray
from drl_av.config.functions import is_users
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene, unwritable
from drl_av.errors import ConfigError, printable


class Rule(Flag):
    """The safety rules of Sec. III of the paper, as flags that can be combined."""

    NONE = 0
    IN_LANE = auto()
    """Rule 1: the ego is faster than the vehicle ahead and too close to it."""
    OFF_ROAD = auto()
    """Rule 2: the target lane does not exist or is closed."""
    LANE_CHANGE = auto()
    """Rule 3: the gap to a vehicle is too small for the lane change."""

    @cache
    def __str__(self) -> str:
        words = [str(rule.name).lower() for rule in Rule if rule in self]
        return "+".join(words) or "none"


class Verdict(NamedTuple):
    """The action that the ego executes, and the rules that changed the proposed action.

    ``rule`` is ``Rule.NONE`` if no rule changed it. A check of the user may name rules of its own
    by any text.
    """

    action: Action
    rule: Rule | str


RULES = tuple(map(Rule, range(8)))
"""Each combination of rules, by its number."""
IN_LANE, OFF_ROAD, LANE_CHANGE = (rule.value for rule in Rule)
"""The numbers of the three rules, for compiled functions."""


class Verdicts(NamedTuple):
    """The verdicts on all 12 actions in a scene, by the number of the proposed action."""

    executed: IntArray
    """Shape (12,): the number of the action that the ego executes."""
    rules: IntArray
    """Shape (12,): the rules that replaced the proposed action, an index of ``RULES``."""

    def of(self, proposed: Action) -> Verdict:
        """Return the verdict on one action."""
        number = proposed.number
        return Verdict(ACTIONS[self.executed[number]], RULES[self.rules[number]])


class WholeCheck:
    """A check that judges all 12 actions of a scene at once."""

    def verdicts(self, scene: Scene) -> Verdicts:
        """Return the verdicts on all actions."""
        raise NotImplementedError

    def __call__(self, scene: Scene, proposed: Action) -> Verdict:
        """Return the verdict on one action."""
        return self.verdicts(scene).of(proposed)


SafetyCheck = Callable[[Scene, Action], Verdict]
"""A function that returns the verdict on a proposed action in a scene."""


def whole_verdicts(check: SafetyCheck, scene: Scene) -> Verdicts | None:
    """Return the verdicts on all actions of a check that has no ``__call__`` of its own, else None.

    Raises:
        ConfigError: the check is a user's, and these are no verdicts.
    """
    if not isinstance(check, WholeCheck) or type(check).__call__ is not WholeCheck.__call__:
        return None
    if not is_users(type(check).verdicts):
        return check.verdicts(scene)
    with unwritable(check.verdicts, scene):
        return _require_verdicts(check.verdicts(scene))


def _require_verdicts(verdicts: Verdicts) -> Verdicts:
    """Return the verdicts, without rules for an action that is kept, as ``apply_check`` does.

    Raises ConfigError unless they are numbers of actions and of rules.
    """
    with suppress(TypeError, ValueError):
        whole = (np.asarray(part).astype(np.int64, casting="safe") for part in verdicts)
        found, numbers = Verdicts(*whole), np.arange(len(ACTIONS))
        known = np.isin(found.executed, numbers) & np.isin(found.rules, np.arange(len(RULES)))
        known &= (found.executed == numbers) | (found.rules > 0)
        if known.shape == numbers.shape and known.all():
            return found._replace(rules=np.where(found.executed == numbers, 0, found.rules))
    raise ConfigError(
        f"The safety check returned the verdicts {verdicts!r}, but must return, for each of the "
        f"{len(ACTIONS)} actions, the number of the executed action and of the rules that replaced "
        "it, 0 for none."
    )


def apply_check(check: SafetyCheck, scene: Scene, proposed: Action) -> Verdict:
    """Call a check, which the user may have written, and return its verdict.

    A verdict that keeps the proposed action has the rule ``Rule.NONE``, whatever the check named.
    Meanwhile the arrays of the scene cannot be written: the world goes on with them.

    Raises:
        ConfigError: the check did not return a Verdict with one of the 12 actions and a Rule or a
            text, or replaced the action and named no rule.
    """
    with unwritable(check, scene):
        verdict = check(scene, proposed)
    is_verdict = isinstance(verdict, Verdict) and isinstance(verdict.rule, Rule | str)
    is_action = is_verdict and isinstance(verdict.action, Action)
    if not is_action or verdict.action not in ACTIONS:
        raise ConfigError(
            f"The safety check returned {verdict!r}, but must return a Verdict: "
            "Verdict(proposed, Rule.NONE) permits the action."
        )
    action, rule = ACTIONS[ACTIONS.index(verdict.action)], verdict.rule
    if action == proposed:
        return Verdict(action, Rule.NONE)
    if isinstance(rule, str):
        rule = printable(rule.strip())
    if str(rule) in ("", str(Rule.NONE)):
        raise ConfigError(
            f"The safety check replaced the action {proposed} by {action}, but named no "
            "rule: return Rule.IN_LANE, Rule.OFF_ROAD, Rule.LANE_CHANGE or a text of yours in the "
            "Verdict."
        )
    return Verdict(action, rule)


def permit_all(scene: Scene, proposed: Action) -> Verdict:
    """Return the verdict that permits the proposed action in every scene (the paper's ablation)."""
    return Verdict(proposed, Rule.NONE)
