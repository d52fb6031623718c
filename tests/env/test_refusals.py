"""Arguments, options and actions that the environment refuses."""

from typing import Any

import pytest
from drives import KEEP, start

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ConfigError, ScenarioError


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"vehicle": 3}, r"reset has no option 'vehicle'.*; its options are: vehicles"),
        ({"vehicles": -1}, r"vehicles is -1, but must be a whole number from 0"),
        ({"vehicles": 2.5}, r"vehicles is 2.5, but must be a whole number"),
        ({"vehicles": "many"}, r"vehicles is 'many', but must be a whole number"),
    ],
)
def test_reset_refuses_what_it_does_not_know(
    env: HighwayEnv, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        env.reset(seed=0, options=options)


def test_reset_refuses_more_vehicles_than_fit_and_continues_after_it(env: HighwayEnv) -> None:
    with pytest.raises(
        ScenarioError, match=r"^This road has room for 113 vehicles besides .* not for 500: "
    ):
        start(env, 500)
    start(env, 113)
    env.step(KEEP)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"safety_check": "papper"}, r"'papper' \(did you mean 'paper'\?\)"),
        ({"safety_check": 5}, "safety_check is 5, but must be a function of"),
        ({"render_mode": "ansi"}, r"render_mode is 'ansi', but must be None, 'human' or 'rgb_arr"),
        ({"config": "/nowhere/settings.toml"}, r"/nowhere/settings.toml', but must be a preset"),
        ({"scenario": 3}, r"^scenario is of the type int, but must be a folder or the name of a"),
        ({"scenario": Config()}, r"^scenario is of the type Config, .* are the argument config\.$"),
        ({"observation": [["ego"]]}, r"no group of indicators \['ego'\].*; the groups are"),
    ],
)
def test_an_environment_refuses_bad_arguments(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        HighwayEnv(**arguments)
