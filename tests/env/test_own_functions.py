"""Functions of the user that take other arguments than they are given: one sentence at once."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

import drl_av
from drl_av.config.functions import require_function
from drl_av.drivers.checked import PolicyDriver
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ConfigError


class Timid:
    """A driver whose ``act`` lacks the observation."""

    def start(self, seed: int) -> None:
        """Stateless."""

    def act(self, scene: Any) -> Any:
        raise AssertionError("it must never be called")


class Unseeded(Timid):
    def start(self) -> None:
        raise AssertionError("it must never be called")


class Nothing:
    """An observation that does not take the scene."""

    space = gymnasium.spaces.Box(0, 1, shape=(1,), dtype=np.float32)

    def __call__(self) -> Any:
        raise AssertionError("it must never be called")


def pair(first: Any, second: Any) -> float:
    return 0.0


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (
            lambda: HighwayEnv(reward=pair),
            "reward is called with (transition), which pair(first: Any, second: Any) -> float does "
            "not take (missing a required argument: 'second'): change its arguments.",
        ),
        (
            lambda: HighwayEnv(safety_check=lambda scene: scene),
            "safety_check is called with (scene, proposed), which <lambda>(scene) does not take "
            "(too many positional arguments): change its arguments.",
        ),
        (
            lambda: HighwayEnv(observation=Nothing()),
            "observation is called with (scene), which Nothing() -> Any does not take (too many "
            "positional arguments): change its arguments.",
        ),
        (
            lambda: PolicyDriver(lambda: 1),
            "policy is called with (observation), which <lambda>() does not take (too many "
            "positional arguments): change its arguments.",
        ),
        (
            lambda: PolicyDriver(lambda seen: 1, 7),
            "observe is 7, but must be a function of (scene).",
        ),
        (
            lambda: drl_av.evaluate(own={"mine": Timid()}),
            "The method act of the driver 'mine' is called with (scene, observation), which "
            "act(scene: Any) -> Any does not take (too many positional arguments): change its "
            "arguments.",
        ),
        (
            lambda: drl_av.evaluate(own={"mine": Unseeded()}),
            "The method start of the driver 'mine' is called with (seed), which start() -> None "
            "does not take (too many positional arguments): change its arguments.",
        ),
    ],
)
def test_the_function_its_arguments_and_those_that_it_gets_are_named(
    made: Callable[[], object], message: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        made()
    assert str(caught.value) == message


class Needy:
    """An observation that cannot be made without an argument."""

    def __init__(self, size: int) -> None:
        self.space = gymnasium.spaces.Box(0, 1, (size,))


def test_a_class_that_needs_arguments_is_refused_by_its_name() -> None:
    with pytest.raises(ConfigError, match=r"Needy' is called with \(\), which Needy\(size: int\)"):
        HighwayEnv(observation=f"{__name__}:Needy")


def test_a_class_in_place_of_an_observation_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"observation is <class .*, but must be wide, names of groups"
    ):
        HighwayEnv(observation=Nothing)


@pytest.mark.parametrize("fits", [pair, lambda *any: 0, lambda a, b, c=1, *, d=2: 0, max])
def test_functions_that_take_the_arguments_pass_and_so_do_those_without_a_signature(
    fits: Callable[..., object],
) -> None:
    require_function(fits, "it", "first", "second")
