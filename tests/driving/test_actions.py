"""The 12 decisions, in the order of their numbers."""

import numpy as np
import pytest

from drl_av.config import EgoConfig
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal, action_of, toward
from drl_av.errors import ConfigError


@pytest.mark.parametrize("number", [7, np.int64(7), np.array(7), np.array([7])])
def test_a_policy_may_return_any_integer_of_an_action(number: object) -> None:
    assert action_of(number) == ACTIONS[7]


@pytest.mark.parametrize("number", [12, -1, 2.9, np.array(2.9), "x", None, np.zeros(12, int)])
def test_what_is_no_action_is_refused_and_not_rounded(number: object) -> None:
    with pytest.raises(ConfigError, match="an action is a whole number from 0 to 11"):
        action_of(number)


def test_the_twelve_decisions_are_numbered_lateral_first() -> None:
    assert [str(action) for action in ACTIONS] == [
        *("maintain, keep lane", "accelerate, keep lane"),
        *("brake, keep lane", "hard brake, keep lane"),
        *("maintain, change right", "accelerate, change right"),
        *("brake, change right", "hard brake, change right"),
        *("maintain, change left", "accelerate, change left"),
        *("brake, change left", "hard brake, change left"),
    ]


def test_a_number_and_a_pair_are_the_same_decision() -> None:
    assert [action.number for action in ACTIONS] == list(range(12))
    assert ACTIONS[6] == Action(Lateral.RIGHT, Longitudinal.BRAKE)  # not (2, 1), left
    assert Action(Lateral.LEFT, Longitudinal.ACCELERATE).number == 9


def test_accelerations_follow_the_config() -> None:
    ego = EgoConfig(accelerate_m_s2=1.0, brake_m_s2=3.0, hard_brake_m_s2=8.0)
    assert [how.acceleration_m_s2(ego) for how in Longitudinal] == [0.0, 1.0, -3.0, -8.0]


def test_left_is_positive_and_right_is_negative() -> None:
    assert [lateral.sign for lateral in (Lateral.KEEP, Lateral.RIGHT, Lateral.LEFT)] == [0, -1, 1]


@pytest.mark.parametrize("lateral", Lateral)
def test_the_action_toward_a_side_leads_there_and_that_away_from_it_back(lateral: Lateral) -> None:
    assert toward(lateral.sign) is lateral
    assert toward(-lateral.sign).sign == -lateral.sign
