"""Reading vehicles through libsumo's inner getters, and through traci."""

from types import ModuleType, SimpleNamespace

import libsumo
import pytest

from drl_av.env.highway import HighwayEnv
from drl_av.simulation.vehicle_calls import getters

NAMES = ("getSpeed", "getLaneID")


def test_a_module_that_has_nothing_within_is_read_as_it_is() -> None:
    traci = ModuleType("traci")
    traci.vehicle = SimpleNamespace(getSpeed=lambda name: 3.0, getLaneID="{}_0".format)  # type: ignore[attr-defined]
    speed, lane = getters(traci, NAMES)
    assert (speed("ego"), lane("e1")) == (3.0, "e1_0")


def test_libsumo_says_the_same_within_and_refuses_the_same() -> None:
    with HighwayEnv() as env:
        env.reset(seed=1, options={"vehicles": 5})
        speed, lane = getters(libsumo, NAMES)
        assert speed is not libsumo.vehicle.getSpeed
        for name in env.scene.snapshot.ids:
            assert speed(name) == libsumo.vehicle.getSpeed(name)
            assert lane(name) == libsumo.vehicle.getLaneID(name)
        with pytest.raises(libsumo.TraCIException, match="'absent' is not known"):
            speed("absent")
