"""Environments that the tests of this room share."""

from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
from drives import Place

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.scenarios.folder import PlacedVehicle, ScenarioDescription, write_scenario


@pytest.fixture(scope="module")
def env() -> Iterator[HighwayEnv]:
    """The environment as it comes; every test resets it."""
    with closing(HighwayEnv()) as made:
        yield made


@pytest.fixture(scope="module")
def unchecked() -> Iterator[HighwayEnv]:
    """Without a safety check."""
    with closing(HighwayEnv(safety_check="permit_all")) as made:
        yield made


@pytest.fixture(scope="module")
def barricaded() -> Iterator[HighwayEnv]:
    with closing(HighwayEnv("barricaded_right_lane")) as made:
        yield made


@pytest.fixture
def place(tmp_path: Path, stack: ExitStack) -> Place:
    """Makes an environment in which vehicles stand exactly where a test wants them."""

    def placed(
        *vehicles: PlacedVehicle, kind: type[Any] = ScenarioDescription, **arguments: Any
    ) -> HighwayEnv:
        folder = tmp_path / f"scenario{len(list(tmp_path.iterdir()))}"
        write_scenario(folder, kind(vehicles=vehicles))
        usual = {"safety_check": "permit_all", "config": Config().with_traffic("calm")}
        env = HighwayEnv(folder, **(usual | arguments))
        return stack.enter_context(closing(env))

    return placed
