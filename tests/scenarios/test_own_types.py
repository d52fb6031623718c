"""Vehicle types of the user's own in a scenario, and scenarios from a TOML file."""

import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
from nets import needed
from plain_sumo import states
from runs import Capsys, refused_scenario

from drl_av.cli import main
from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ConfigError, ScenarioError
from drl_av.random_streams import Stream, generator
from drl_av.scenarios.custom_vehicle_types import CustomVehicleType, draw_types
from drl_av.scenarios.folder import load_scenario, write_scenario
from drl_av.scenarios.highways import StraightDescription
from drl_av.scenarios.loop import ScenarioDescription
from drl_av.scenarios.road_description import PlacedVehicle
from drl_av.scenarios.road_types import ROAD_TYPES, from_toml

TRUCK = CustomVehicleType("truck", 0.3, 14.0, 2.5)
TAXI = CustomVehicleType("taxi", 0.2, 4.5, 1.7, "Krauss")
SHARES = {"truck": 0.3, "taxi": 0.2, "traffic": 0.5}
SIZES_M = {"truck": (14.0, 2.5), "taxi": (4.5, 1.7), "traffic": (5.0, 1.8), "ego": (5.0, 1.8)}
MIXED = """
circumference_m = 800
speed_limit_m_s = 45
barricaded_lanes = [0]
[[vehicle_types]]
id = "truck"
share = 0.3
length_m = 14
width_m = 2.5
[[vehicle_types]]
id = "taxi"
share = 0.2
length_m = 4.5
width_m = 1.7
car_following_model = "Krauss"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A loop with trucks and taxis, written by the command line from a file."""
    home = tmp_path_factory.mktemp("own")
    (home / "mixed.toml").write_text(MIXED)
    assert main(["scenario", str(home / "mixed"), "--from", str(home / "mixed.toml")]) == 0
    return home / "mixed"


def test_the_file_describes_the_scenario_and_is_kept_in_it(folder: Path) -> None:
    written = from_toml((folder / "scenario.toml").read_text())
    assert written.vehicle_types == (TRUCK, TAXI)
    assert (written.circumference_m, written.speed_limit_m_s) == (800, 45)
    assert written.open_lanes == (False, True, True)
    assert "vehicle_types" not in ScenarioDescription().to_toml()


def test_an_option_changes_what_the_file_says(tmp_path: Path, folder: Path) -> None:
    words = ["--from", str(folder / "scenario.toml"), "--circumference-m", "900"]
    assert main(["scenario", str(tmp_path / "longer"), *words, "--barricade", "2"]) == 0
    longer = load_scenario(tmp_path / "longer").description
    assert (longer.circumference_m, longer.barricaded_lanes) == (900, (2,))
    assert longer.vehicle_types == (TRUCK, TAXI)


def test_sumo_drives_each_vehicle_with_its_type_and_the_snapshot_has_its_size(folder: Path) -> None:
    with HighwayEnv(folder) as env:
        env.reset(seed=3, options={"vehicles": 12})
        sumo, shot = env.simulation._sumo, env.scene.snapshot
        found = [sumo.vehicle.getTypeID(name).partition("@")[0] for name in shot.ids]
        assert set(found) == set(SIZES_M)
        assert found == [*islice(draw_types(3, (TRUCK, TAXI)), 13)]
        for row, name in enumerate(shot.ids):
            assert (shot.length_m[row], shot.width_m[row]) == SIZES_M[found[row]]
            assert sumo.vehicle.getLength(name) == shot.length_m[row]
        assert sumo.vehicletype.getParameter("taxi", "carFollowModel") in ("", "Krauss")


def test_the_trucks_of_a_kind_of_traffic_are_among_vehicles_of_no_type_of_the_user(
    folder: Path,
) -> None:
    config = Config().with_traffic("naturalistic")  # a tenth are trucks of 12 m
    with HighwayEnv(folder, config=config) as env:
        env.reset(seed=4, options={"vehicles": 30})
        sumo, shot = env.simulation._sumo, env.scene.snapshot
        kinds = [sumo.vehicle.getTypeID(name).partition("@")[0] for name in shot.ids]
        sizes = zip(kinds, shot.length_m.tolist(), shot.width_m.tolist(), strict=True)
        trucks = ("traffic", 12.0, 2.5)
        assert {*sizes} == {trucks, *((kind, *size) for kind, size in SIZES_M.items())}
        assert shot.length_m.tolist() == [*map(sumo.vehicle.getLength, shot.ids)]


def test_the_shares_are_those_of_the_types_and_the_ego_has_its_own() -> None:
    ego, *drawn = islice(draw_types(1, (TRUCK, TAXI)), 10_001)
    assert ego == "ego"
    for kind, share in SHARES.items():
        assert drawn.count(kind) / 10_000 == pytest.approx(share, abs=0.02)


def test_no_two_purposes_draw_the_same_random_numbers() -> None:
    first = [generator(7, stream).random() for stream in Stream]
    assert len({*first}) == len(first) == 8


@pytest.mark.parametrize("kind", sorted(ROAD_TYPES.keys() - {"loop"}))
def test_vehicles_that_enter_an_open_road_have_its_types_too(kind: str, tmp_path: Path) -> None:
    given = {"vehicle_types": (TRUCK, TAXI), "flow_per_h": 1500.0}
    described = ROAD_TYPES[kind](**needed(kind), **given)
    write_scenario(tmp_path / "road", described)
    with HighwayEnv(tmp_path / "road") as env:
        driven, known = [], {}
        for seed in (4, 5, 4):
            _, info = env.reset(seed=seed, options={"vehicles": 40})
            first = set(env.scene.snapshot.ids)
            for _ in range(40):
                if not env._over:
                    env.step(0)
            shot, sumo = env.scene.snapshot, env.simulation._sumo.vehicle
            types = {name: sumo.getTypeID(name).partition("@")[0] for name in shot.ids}
            for row, name in enumerate(shot.ids):
                assert (shot.length_m[row], shot.width_m[row]) == SIZES_M[types[name]]
                assert sumo.getLength(name) == shot.length_m[row]
            driven.append((shot.ids, shot.s_m.tolist()))
            known |= {name: types[name] for name in set(shot.ids) - first}
    assert info["vehicles"] == 40
    assert set(known.values()) == {"truck", "taxi", "traffic"}
    assert driven[0] == driven[2] != driven[1]


def departed(folder: Path, seconds: int) -> Counter[str]:
    """The number of vehicles of each type that plain SUMO lets depart in the first seconds."""
    seen = {v.attrib["id"]: v.attrib["type"] for v in states(folder, seconds).iter("vehicle")}
    return Counter(seen.values())


def test_the_demo_traffic_in_plain_sumo_has_the_own_types_by_their_shares(
    folder: Path, tmp_path: Path
) -> None:
    types = {"demo.truck", "demo.taxi", "demo.traffic", "demo.ego"}
    assert set(departed(folder, 2)) == types
    description = StraightDescription(vehicle_types=(TRUCK, TAXI))
    write_scenario(tmp_path / "road", description)
    # 1,000 an hour on each of 3 lanes: some 500 in 600 s
    number = departed(tmp_path / "road", 600)
    others = number.total() - number["ego"]
    assert others > 400
    for kind, share in SHARES.items():
        assert number[f"demo.{kind}"] / others == pytest.approx(share, abs=0.05)


def test_a_demo_truck_is_the_environments_truck_with_mean_parameters(folder: Path) -> None:
    demo, env = (
        next(
            kind.attrib for kind in ET.parse(folder / file).iter("vType") if name in kind.get("id")
        )
        for file, name in (("traffic.rou.xml", "truck"), ("vehicle_types.add.xml", "truck"))
    )
    unlike = {key for key in demo.keys() | env.keys() if demo.get(key) != env.get(key)}
    assert unlike == {"id", "probability", "tau", "lcSpeedGain", "maxSpeed"}
    assert (demo["length"], demo["probability"], demo["tau"]) == ("14.0", "0.3", "1.1")


def test_types_that_make_up_all_traffic_leave_none_of_the_usual_one(tmp_path: Path) -> None:
    bus = CustomVehicleType("demo", 1.0, 12.0, 2.5)
    write_scenario(tmp_path / "buses", ScenarioDescription(vehicle_types=(bus,)))
    assert set(departed(tmp_path / "buses", 2)) == {"demo.demo", "ego"}


def test_vehicles_of_25_m_on_a_loop_of_100_m_have_demo_traffic_too(tmp_path: Path) -> None:
    write_scenario(
        tmp_path / "short", ScenarioDescription(circumference_m=100.0, vehicle_length_m=25.0)
    )
    assert departed(tmp_path / "short", 2) == {"ego": 1, "demo": 2}


def test_strict_accepts_another_size_and_refuses_another_model(tmp_path: Path) -> None:
    write_scenario(tmp_path / "trucks", ScenarioDescription(vehicle_types=(TRUCK,)))
    with HighwayEnv(tmp_path / "trucks", "strict") as env:
        env.reset(seed=1, options={"vehicles": 10})
    write_scenario(tmp_path / "taxis", ScenarioDescription(vehicle_types=(TAXI,)))
    with pytest.raises(ConfigError, match="carFollowModel of the vehicle type taxi must be IDM"):
        HighwayEnv(tmp_path / "taxis", "strict")
    close = CustomVehicleType("close", 1.0, 5.0, 1.8, headway_s=0.5)
    write_scenario(tmp_path / "close", ScenarioDescription(vehicle_types=(close,)))
    HighwayEnv(tmp_path / "close", "strict").close()
    write_scenario(
        tmp_path / "tight", ScenarioDescription(vehicle_types=(replace(close, headway_s=0.4),))
    )
    with pytest.raises(
        ConfigError, match=r"at most the tau of the vehicle type close, 0\.4, and n"
    ):
        HighwayEnv(tmp_path / "tight", "strict")
    HighwayEnv(tmp_path / "tight", "paper").close()
    write_scenario(
        tmp_path / "wide", ScenarioDescription(vehicle_types=(replace(close, width_m=3.75),))
    )
    with pytest.raises(ConfigError, match=r"width of the vehicle type close must be at most 3\.7,"):
        HighwayEnv(tmp_path / "wide", "strict")


@pytest.mark.parametrize(
    ("types", "message"),
    [
        ({"share": 1.2}, "share is 1.2, but must be a number from 0 to 1"),
        ({"length_m": "long"}, "length_m is 'long', but must be a number from 1 to 25"),
        ({"width_m": 4.5}, "width_m is 4.5, but must be at most lane_width_m, 3.8"),
        ({"id": "ego"}, "'ego', which is the type of other vehicles: rename it"),
        ({"id": "a b"}, "must be made of letters, digits and _"),
        ({"car_following_model": "Kraus"}, "did you mean 'Krauss'"),
        ({"model": "IDM"}, "There is no key 'model' in a vehicle type"),
    ],
)
def test_a_wrong_type_is_refused_in_one_sentence(types: dict[str, Any], message: str) -> None:
    values = {"id": "truck", "share": 0.3, "length_m": 14.0, "width_m": 2.5} | types
    text = "[[vehicle_types]]\n" + "".join(f"{key} = {value!r}\n" for key, value in values.items())
    with pytest.raises(ScenarioError, match=message) as caught:
        from_toml(text)
    assert "\n" not in str(caught.value)


def test_types_that_do_not_fit_each_other_are_refused() -> None:
    many = CustomVehicleType("bus", 0.8, 12.0, 2.5)
    with pytest.raises(ScenarioError, match=r"truck, bus add up to 1.1, but must be at most 1"):
        ScenarioDescription(vehicle_types=(TRUCK, many))
    with pytest.raises(ScenarioError, match="Two vehicle types are called 'truck'"):
        ScenarioDescription(vehicle_types=(TRUCK, TRUCK))
    placed = (PlacedVehicle("ego", 1, 50.0, 20.0, 30.0),)
    with pytest.raises(ScenarioError, match="leave one of the two out"):
        ScenarioDescription(vehicle_types=(TRUCK,), vehicles=placed)
    with pytest.raises(ScenarioError, match="The key 'share' is missing in a vehicle type"):
        from_toml('[[vehicle_types]]\nid = "truck"\n')


@pytest.mark.parametrize(
    ("text", "words", "message"),
    [
        (None, [], "is missing: correct the path or the file"),
        ("lanes = ", [], "is not valid TOML"),
        ("lane = 3", [], "did you mean 'lanes'"),
        ("", ["--kind", "merge"], "describes a scenario of the kind loop, and --kind is merge"),
        ("", ["--ramp-m", "100"], "of the kind loop has no --ramp-m"),
    ],
)
def test_a_wrong_file_is_refused_in_one_sentence(
    text: str | None, words: list[str], message: str, tmp_path: Path, capsys: Capsys
) -> None:
    if text is not None:
        (tmp_path / "wrong.toml").write_text(text)
    source = ["--from", str(tmp_path / "wrong.toml")]
    assert message in refused_scenario(capsys, tmp_path, *source, *words)
