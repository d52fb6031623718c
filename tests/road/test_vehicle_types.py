"""A scenario's vehicle types are data: read from its file, and read by all that need them."""

import re
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import libsumo
import pytest

from drl_av.config import Config
from drl_av.drivers.registry import default_config, find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ConfigError, ScenarioError
from drl_av.road.vehicle_types import AS_WRITTEN, read_types, type_attributes
from drl_av.scenarios.folder import (
    PlacedVehicle,
    ScenarioDescription,
    find_scenario,
    load_scenario,
    shipped_scenarios,
    write_scenario,
)
from drl_av.simulation.vehicle_calls import EgoModel

EGO, OTHER = PlacedVehicle("ego", 1, 100.0, 20.0, 30.0), PlacedVehicle("other", 1, 150.0, 20.0, 20)
STRICT = Config().updated("safety", check="strict")
Change = Callable[..., Path]


@pytest.fixture
def changed(tmp_path: Path) -> Change:
    """Writes a scenario, and changes its vehicle types by hand."""

    def change(kind: str, *vehicles: PlacedVehicle, **attributes: str) -> Path:
        folder = tmp_path / "loop"
        write_scenario(folder, ScenarioDescription(vehicles=vehicles))
        path = folder / "vehicle_types.add.xml"
        lines = path.read_text().splitlines()
        row = next(row for row, line in enumerate(lines) if f'id="{kind}"' in line)
        for key, value in attributes.items():
            lines[row], count = re.subn(rf' {key}="[^"]*"', f' {key}="{value}"', lines[row])
            lines[row] = lines[row] if count else lines[row].replace("/>", f' {key}="{value}" />')
        path.write_text("\n".join(lines))
        (folder / "SHA256SUMS").unlink()
        return folder

    return change


def test_the_scenarios_that_ship_have_the_types_as_written() -> None:
    for name in shipped_scenarios():
        assert load_scenario(find_scenario(name)).vehicle_types == AS_WRITTEN
    traffic, ego = AS_WRITTEN.traffic, AS_WRITTEN.ego
    assert (traffic.length_m, traffic.width_m, traffic.acceleration_m_s2) == (5.0, 1.8, 1.5)
    assert (traffic.braking_m_s2, traffic.emergency_braking_m_s2) == (4.0, 4.0)
    assert (traffic.lateral_speed_m_s, ego.acceleration_m_s2) == (0.76, 2.0)
    assert dict(ego.model)["tau"] == "1.5"


def types(**attributes: Any) -> list[dict[str, Any]]:
    traffic, ego = type_attributes(5.0, 1.8)
    return [traffic | attributes, ego]


@pytest.mark.parametrize(
    ("elements", "sentence"),
    [
        (types(decel="hard"), "the vehicle type 'traffic' has decel 'hard', but must have a num"),
        (types(decel="nan"), "has decel 'nan', but must have a number above 0"),
        (types(accel="-1"), "has accel '-1', but must have a number above 0"),
        (types(maxSpeedLat="inf"), "has maxSpeedLat 'inf'"),
        (types(length="26"), "has length '26', but must have a number from 1 to 25"),
        (types(length=None), "has length None"),
        (types(id="lorry"), "there is a vehicle type 'lorry', but the types must be one 'traffic'"),
        (types(id="ego"), "there is a vehicle type 'ego'"),
        (types()[:1], "there is no vehicle type 'ego'"),
        ([], "there is no vehicle type 'ego'"),
    ],
)
def test_types_that_are_none_are_refused_in_one_sentence(
    elements: list[dict[str, Any]], sentence: str
) -> None:
    with pytest.raises(ScenarioError, match=re.escape(sentence)) as refusal:
        read_types(elements, "types.xml")
    assert str(refusal.value).startswith("types.xml: ")


def test_gaps_to_trucks_of_12_m_are_those_that_sumo_sees(changed: Change) -> None:
    # front bumpers 50 m apart: 38 m to the truck's rear
    with closing(HighwayEnv(changed("traffic", EGO, OTHER, length="12", width="2.4"))) as env:
        env.reset(seed=0)
        shot, ahead = env.scene.snapshot, env.scene.affordances.own_front
        assert shot.length_m.tolist() == [5.0, 12.0]
        assert shot.width_m.tolist() == [1.8, 2.4]
        assert shot.s_m.tolist() == [97.5, 144.0]
        assert ahead.gap_m == 38.0
        leader = env.simulation._sumo.vehicle.getLeader("ego", 100.0)
        assert leader == ("other", pytest.approx(38.0 - 2.5))  # SUMO keeps its minGap back


def test_a_long_ego_is_as_long_as_sumo_has_it(changed: Change) -> None:
    with closing(HighwayEnv(changed("ego", EGO, OTHER, length="12"))) as env:
        env.reset(seed=0)
        assert env.scene.snapshot.length_m.tolist() == [12.0, 5.0]
        assert env.scene.snapshot.s_m.tolist() == [94.0, 147.5]
        ahead = env.scene.affordances.own_front
        assert ahead.gap_m == 45.0


def test_an_ego_that_sumo_drives_keeps_its_size(changed: Change) -> None:
    with closing(HighwayEnv(changed("ego", EGO, OTHER, length="12", width="2.4"))) as env:
        env.reset(seed=0)
        env.hand_over(EgoModel())
        vehicle = libsumo.vehicle
        assert (vehicle.getLength("ego"), vehicle.getWidth("ego")) == (12.0, 2.4)
        assert vehicle.getTypeID("ego") != "ego"


def test_vehicles_that_grew_into_each_other_are_refused(changed: Change) -> None:
    near = PlacedVehicle("near", 1, 110.0, 20.0, 20.0)
    with pytest.raises(ScenarioError, match=r"vehicle_types.add.xml: .*'near' overlap on lane 1"):
        load_scenario(changed("traffic", EGO, near, length="12"))


def test_random_traffic_of_trucks_starts_and_stays_apart(changed: Change) -> None:
    with closing(HighwayEnv(changed("traffic", length="12", width="2.4"), config=STRICT)) as env:
        assert env.simulation.fleet.capacity == 3 * 25 - 1  # 500 m in berths of 12 + 8 m
        for seed in range(3):
            env.reset(seed=seed, options={"vehicles": 30})
            for _ in range(40):
                *_, terminated, _, _ = env.step(9)
                assert not terminated


@pytest.mark.parametrize(
    ("kind", "attributes", "sentence"),
    [
        (
            *("traffic", {"decel": "9", "emergencyDecel": "9"}),
            "decel of the vehicle type traffic must be at most strict.braking_m_s2, 4, and not 9",
        ),
        ("traffic", {"emergencyDecel": "9"}, "the emergencyDecel of the vehicle type traffic must"),
        ("traffic", {"maxSpeedLat": "1.5"}, "must be at most strict.lateral_speed_m_s, 0.76, and "),
        ("traffic", {"decel": "3.5"}, "at most the decel of the vehicle type traffic, 3.5, and no"),
        (
            *("ego", {"decel": "4.5"}),
            "must be at most ego.hard_brake_m_s2, 4, and not 4.5, because bound 3 fails",
        ),
        ("ego", {"tau": "1"}, "the tau of the vehicle type ego must be 1.5, and not 1: undo the"),
        ("traffic", {"minGap": "0.5"}, "the minGap of the vehicle type traffic must be 2.5, and"),
        (
            *("traffic", {"lcAssertive": "5"}),
            "lcAssertive of the vehicle type traffic must be the default of SUMO, and not 5",
        ),
        ("traffic", {"carFollowModel": "Krauss"}, "carFollowModel of the vehicle type traffic mus"),
    ],
)
def test_types_that_break_the_bounds_of_strict_are_refused_under_it(
    changed: Change, kind: str, attributes: dict[str, str], sentence: str
) -> None:
    folder = changed(kind, **attributes)
    with pytest.raises(ConfigError, match=re.escape(sentence)):
        HighwayEnv(folder, safety_check="strict")
    HighwayEnv(folder, safety_check="paper").close()


def test_bounds_that_follow_the_types_are_accepted(changed: Change) -> None:
    folder = changed("traffic", decel="9", emergencyDecel="9", maxSpeedLat="1.5", color="1,1,1")
    bounds = {"braking_m_s2": 9.0, "lateral_speed_m_s": 1.5}
    HighwayEnv(folder, config=STRICT.updated("strict", **bounds)).close()


def test_a_driver_that_proposes_permitted_actions_asks_the_check_for_the_types_of_the_scenario(
    changed: Change,
) -> None:
    folder, specs = changed("traffic", maxSpeedLat="0.5"), find_drivers(["pretrained-ramp_to_ramp"])
    config = default_config(specs).updated("simulation", scenario=str(folder))
    narrow = config.updated("strict", lateral_speed_m_s=0.5)  # types as written have 0.76
    HighwayEnv(config=narrow).close()
    assert make_drivers(specs, narrow)
    with pytest.raises(ConfigError, match="maxSpeedLat of the vehicle type traffic must be at mos"):
        make_drivers(specs, config.updated("strict", lateral_speed_m_s=0.4))


def test_settings_of_strict_do_not_decide_who_yields_in_the_traffic() -> None:
    # with them, vehicles of this episode gave way to each other from other distances
    config = Config().with_traffic("calm").updated("traffic", finite_state_share=1.0)
    ends = []
    for braking in (4.0, 1.0):
        moved = config.updated("strict", follower_braking_m_s2=braking)
        with closing(HighwayEnv(config=moved)) as env:
            env.reset(seed=1, options={"vehicles": 20})
            for _ in range(100):
                env.step(0)
            ends.append((env.scene.snapshot.s_m.tolist(), env.scene.snapshot.y_m.tolist()))
    assert ends[0] == ends[1]
