"""Scenario folders, with the real netconvert and the real SUMO."""

import os
import re
import shutil
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from plain_sumo import states
from runs import files_of, replace_in

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ConfigError, ScenarioError, SimulationError
from drl_av.scenarios import netconvert
from drl_av.scenarios.folder import (
    PlacedVehicle,
    ScenarioDescription,
    find_scenario,
    load_scenario,
    read_description,
    shipped_scenarios,
    write_scenario,
)
from drl_av.scenarios.road_types import ROAD_TYPES, from_toml

CHECKOUT = Path(__file__).parents[2]
SHIPPED = {
    "circular_three_lane": ScenarioDescription(),
    "barricaded_right_lane": ScenarioDescription(barricaded_lanes=(0,)),
}
PLACED = ScenarioDescription(
    vehicles=(PlacedVehicle("ego", 1, 2.0, 20.0, 30.0), PlacedVehicle("slow", 1, 124.9, 10.0, 12.0))
)
PLACED_TOML = PLACED.to_toml()


OPEN = {kind: ROAD_TYPES[kind]() for kind in ("straight", "merge", "exit", "ramp_to_ramp")}


@pytest.mark.parametrize("name", shipped_scenarios())
def test_shipped_scenario_is_regenerated_byte_for_byte(name: str, tmp_path: Path) -> None:
    folder = CHECKOUT / "sumo_scenarios" / name
    described = read_description(folder / "scenario.toml")
    assert described == (SHIPPED | OPEN).get(name, described)
    write_scenario(tmp_path / "elsewhere", described)
    made, kept = files_of(tmp_path / "elsewhere"), files_of(folder)
    assert made == kept
    scenario = load_scenario(folder)
    assert scenario.as_written
    assert scenario.description == described


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenario_opens_in_plain_sumo_with_moving_traffic(
    name: str, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(find_scenario(name), tmp_path / name))
    steps = states(folder, 600).findall("timestep")
    assert [len(step) for step in steps] == [16] * 1200
    lanes = {vehicle.attrib["lane"][-1] for step in steps for vehicle in step}
    assert lanes == ({"1", "2"} if name == "barricaded_right_lane" else {"0", "1", "2"})
    assert "ego" in {vehicle.get("id") for vehicle in steps[-1]}
    assert all(float(vehicle.attrib["speed"]) > 10 for vehicle in steps[-1])


def test_barricade_is_drawn_along_the_outer_lane() -> None:
    scenario = load_scenario(find_scenario("barricaded_right_lane"))
    polygons = ET.parse(scenario.additional_files[1]).getroot().findall("poly")
    blocks = [polygon for polygon in polygons if polygon.get("type") == "barricade"]
    corner = blocks[0].attrib["shape"].split()[0]
    radius_m = sum(float(value) ** 2 for value in corner.split(",")) ** 0.5
    assert len(blocks) == 83
    assert radius_m == pytest.approx(500 / 6.283185307 + 3.8 - 0.4, abs=1e-3)


def test_default_scenario_is_the_papers_loop() -> None:
    scenario = load_scenario(find_scenario())
    assert scenario.folder.name == "circular_three_lane"
    assert scenario.road.lap_m == 500.0
    assert scenario.road.open_lanes == (True, True, True)
    assert scenario.layout.route("loop", 0.0)[:5] == ["e0", "e1", "e2", "e3", "e0"]
    assert scenario.layout.lane_positions["e2_1"] == (1, 250.0)
    assert len(scenario.layout.lane_positions) == 12
    for path in (scenario.network_file, scenario.view_file):
        assert path.is_file()


def test_loop_is_driven_counter_clockwise_with_the_rightmost_lane_outside() -> None:
    root = ET.parse(load_scenario(find_scenario()).network_file).getroot()
    shapes = {lane.attrib["id"]: lane.attrib["shape"] for lane in root.iter("lane")}
    first = [[float(v) for v in pair.split(",")] for pair in shapes["e0_0"].split()]
    (x0, y0), (x1, y1) = first[0], first[1]
    assert x0 * y1 - x1 * y0 > 0
    assert x0 > float(shapes["e0_2"].split(",")[0])


@settings(
    max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    circumference_m=st.floats(200, 3000, allow_nan=False),
    lanes=st.integers(1, 5),
    barricade=st.booleans(),
)
@example(circumference_m=1000 / 3, lanes=5, barricade=True)
def test_every_lane_is_exactly_the_circumference_long(
    circumference_m: float, lanes: int, barricade: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    barricaded = (lanes - 1,) if barricade and lanes > 1 else ()
    wanted = ScenarioDescription(circumference_m, lanes, barricaded_lanes=barricaded)
    folder = tmp_path_factory.mktemp("loop") / "scenario"
    write_scenario(folder, wanted)
    root = ET.parse(folder / "highway.net.xml").getroot()
    for lane in range(lanes):
        pieces = root.findall(f"edge/lane[@index='{lane}']")
        total_m = sum(float(piece.attrib["length"]) for piece in pieces)
        assert abs(total_m - circumference_m) < 1e-6
    scenario = load_scenario(folder)
    assert scenario.description == wanted
    assert abs(scenario.road.lap_m - circumference_m) < 1e-6


def test_placed_vehicles_start_exactly_where_they_are_put(tmp_path: Path) -> None:
    write_scenario(tmp_path / "scenario", PLACED)
    assert load_scenario(tmp_path / "scenario").description == PLACED
    first = states(tmp_path / "scenario", 1, "--precision", "6")[0]
    placed = {v.attrib["id"]: (v.attrib["lane"], float(v.attrib["pos"])) for v in first}
    assert placed == {"ego": ("e0_1", 2.0), "slow": ("e0_1", 124.9)}


@settings(max_examples=50)
@given(st.floats(150, 3000), st.integers(1, 4), st.floats(2.5, 5), st.floats(1, 60))
def test_description_survives_toml(c_m: float, lanes: int, width_m: float, limit: float) -> None:
    wanted = ScenarioDescription(c_m, lanes, width_m, limit, barricaded_lanes=(0,) * (lanes > 1))
    assert from_toml(wanted.to_toml()) == wanted
    assert tomllib.loads(wanted.to_toml())["lanes"] == lanes


@pytest.mark.parametrize(
    ("toml", "sentence"),
    [
        ("lanes = ", "scenario.toml is not valid TOML"),
        ('kind = ["loop"]', "There is no kind of scenario ['loop'] (did you mean"),
        ("lane = 3", "no key 'lane' (did you mean 'lanes'?)"),
        ("lanes = 3.0", "lanes is 3.0, but must be a whole number from 1 to 10"),
        ("lanes = true", "lanes is True, but must be a whole number"),
        ("lanes = 0", "lanes is 0, but must be a whole number from 1 to 10"),
        ("circumference_m = 20", "circumference_m is 20.0, but must be a number from 100"),
        ("circumference_m = nan", "circumference_m is nan, but must be a number from 100"),
        ("circumference_m = '500'", "circumference_m is '500', but must be a number"),
        ("circumference_m = 100\nlanes = 8", "must be at least 127 for 8 lanes of 3.8 m"),
        ("lane_width_m = 2\nvehicle_width_m = 2.5", "must be at most lane_width_m, 2"),
        ("barricaded_lanes = [3]", "whole numbers from 0, the rightmost lane, to 2"),
        ("barricaded_lanes = 0", "whole numbers from 0, the rightmost lane, to 2"),
        ("barricaded_lanes = [0, 1, 2]", "one must stay open"),
        ("vehicles = 3", "each written under [[vehicles]]"),
        ("[[vehicles]]\nid = 'ego'", "The key 'lane' is missing in a placed vehicle"),
        (PLACED_TOML.replace("position_m", "positon_m"), "did you mean 'position_m'?"),
        (PLACED_TOML.replace('"slow"', '"ego"'), "Two vehicles are called 'ego'"),
        (PLACED_TOML.replace('"slow"', '"a b"'), "letters, digits, - and _"),
        (PLACED_TOML.replace("124.9", "4.0"), "'ego' and 'slow' overlap on lane 1"),
        (PLACED_TOML.replace("124.9", "498.0"), "'ego' and 'slow' overlap on lane 1"),
        (PLACED_TOML.replace("limit_m_s = 40.0", "limit_m_s = 9.0"), "limit_m_s, 9"),
        (PLACED_TOML.replace("124.9", "500.0"), "must be on a lane open there, before 500 m."),
        (PLACED_TOML.replace("lane = 1", "lane = 3"), "on lane 3 at 2 m, but must be on a lane"),
        (PLACED_TOML.replace("barricaded_lanes = []", "barricaded_lanes = [1]"), "1 at 2 m, but"),
    ],
)
def test_wrong_description_is_one_sentence(folder: Path, toml: str, sentence: str) -> None:
    (folder / "scenario.toml").write_text(toml)
    with pytest.raises(ScenarioError, match=re.escape(sentence)) as refusal:
        load_scenario(folder)
    assert str(folder / "scenario.toml") in str(refusal.value)


@pytest.mark.parametrize("name", ["scenario.toml", "highway.net.xml", "vehicle_types.add.xml"])
def test_missing_file_is_named(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(ScenarioError, match=rf"{name} is missing: write the scenario again"):
        load_scenario(folder)


@pytest.mark.parametrize("name", ["highway.net.xml", "vehicle_types.add.xml"])
def test_file_cut_short_is_named(folder: Path, name: str) -> None:
    path = folder / name
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ScenarioError, match=rf"{name} is damaged or cut short"):
        load_scenario(folder)


def test_a_digit_changed_in_a_file_for_sumo_is_reported_unless_it_is_intended(folder: Path) -> None:
    replace_in(folder / "vehicle_types.add.xml", 'decel="4"', 'decel="5"')
    with pytest.raises(ScenarioError, match=r"changed after .* in 'vehicle_types.add.xml': write"):
        load_scenario(folder)
    (folder / "notes.txt").write_text("weaker brakes")
    (folder / "SHA256SUMS").unlink()
    assert not load_scenario(folder).as_written


def test_binary_file_is_refused(folder: Path) -> None:
    (folder / "scenario.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="cannot be read"):
        load_scenario(folder)


OTHERWISE = "leads its lanes on otherwise than described"


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('<connection from="e3" to="e0"', '<connection from="e3" to="e1"', OTHERWISE),
        ('<connection from="e3" .*?/>', "", OTHERWISE),
        ('from="e1" (.*?) toLane="0"', r'from="e1" \1 toLane="1"', OTHERWISE),
        ("<edge id=.*</edge>", "", "has other lanes than described, one is 'e0_0'"),
        ('length="125.000000"', 'length="125.100000"', "length 125.100000 on lane 'e0_0', not 125"),
        (' width="3.800000"', "", "has width None on lane 'e0_0', not 3.8"),
        ('speed="40.000000"', 'speed="30.000000"', "has speed 30.000000 on lane 'e0_0', not 40"),
        ('<lane id="e3_2".*?/>', "", "has other lanes than described, one is 'e3_2'"),
    ],
)
def test_road_that_is_not_the_described_loop_is_refused(
    folder: Path, old: str, new: str, sentence: str
) -> None:
    path = folder / "highway.net.xml"
    spoilt, count = re.subn(old, new, path.read_text(), flags=re.DOTALL)
    assert count
    path.write_text(spoilt)
    with pytest.raises(ScenarioError, match=re.escape(sentence)) as refusal:
        load_scenario(folder)
    assert str(path) in str(refusal.value)


def test_missing_folder_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"There is no scenario folder .*nowhere"):
        load_scenario(tmp_path / "nowhere")


def test_full_folder_is_never_overwritten(folder: Path) -> None:
    before = files_of(folder)
    with pytest.raises(ScenarioError, match="exists and is not empty"):
        write_scenario(folder, ScenarioDescription(1000.0))
    assert files_of(folder) == before


def test_empty_folder_is_filled_and_parents_are_made(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for place in ("empty", "a/b/new"):
        write_scenario(tmp_path / place, ScenarioDescription())
        assert load_scenario(tmp_path / place).road.lap_m == 500.0


def fake_netconvert(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    program = folder / "netconvert"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setattr(netconvert, "program", lambda name: program)


@pytest.mark.skipif(os.name == "nt", reason="shell scripts")
@pytest.mark.parametrize(
    ("script", "error", "sentence"),
    [
        (
            "echo 'netconvert: error while loading shared libraries: libX11.so.6: cannot open "
            "shared object file: No such file' >&2; exit 127",
            SimulationError,
            "needs the system library libX11.so.6, which this machine lacks: install it",
        ),
        (
            "echo 'libgdal.so.26: failed to map segment from shared object' >&2; exit 127",
            SimulationError,
            "not enough memory to load SUMO's netconvert (libgdal.so.26: failed to map segment",
        ),
        ("echo Error: bad edge >&2; exit 1", ScenarioError, "cannot build this road: Error: bad"),
        ("exit 3", ScenarioError, "cannot build this road: exit status 3"),
    ],
)
def test_failing_netconvert_is_reported_and_leaves_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    script: str,
    error: type[Exception],
    sentence: str,
) -> None:
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    fake_netconvert(bin_folder, monkeypatch, script)
    with pytest.raises(error, match=re.escape(sentence)):
        write_scenario(tmp_path / "scenario", ScenarioDescription())
    assert [path.name for path in tmp_path.iterdir()] == ["bin"]


def test_absent_netconvert_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("drl_av.sumo_programs._folder", lambda distribution: None)
    with pytest.raises(SimulationError, match="pip install eclipse-sumo"):
        netconvert.program("netconvert")


def test_scenario_is_found_by_name_or_folder(folder: Path) -> None:
    assert set(shipped_scenarios()) > {*SHIPPED, *OPEN}
    assert find_scenario("barricaded_right_lane").name == "barricaded_right_lane"
    assert find_scenario(folder) == folder
    assert find_scenario(str(folder)) == folder


def test_wheel_lists_every_package_and_the_scenarios() -> None:
    build = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["tool"]["setuptools"]
    folders = [init.parent for init in (CHECKOUT / "drl_av").rglob("__init__.py")]
    found = {".".join(folder.relative_to(CHECKOUT).parts) for folder in folders}
    assert set(build["packages"]) == found | {"drl_av.sumo_scenarios", "verification.proofs"}


def test_the_demo_traffic_has_the_parameters_of_the_environment_s(tmp_path: Path) -> None:
    placed = (
        PlacedVehicle("ego", 0, 50.0, 20.0, 30.0),
        PlacedVehicle("slow", 2, 160.0, 20.0, 21.0),
        PlacedVehicle("quick", 2, 100.0, 20.0, 29.0),
    )
    write_scenario(tmp_path / "story", ScenarioDescription(vehicles=placed))
    steps = {float(step.attrib["time"]): step for step in states(tmp_path / "story", 40)}
    calm = Config().updated("traffic", random_lane_changes_per_s=0.0)
    with HighwayEnv(tmp_path / "story", "permit_all", calm) as env:
        env.reset(seed=1)
        for second in range(1, 40):
            env.step(0)
            alone = {vehicle.attrib["id"]: vehicle.attrib for vehicle in steps[float(second)]}
            for row, name in enumerate(env.scene.snapshot.ids[1:], start=1):
                speed = env.scene.snapshot.speed_m_s[row]
                assert float(alone[name]["speed"]) == pytest.approx(speed, abs=0.3), (second, name)
                assert alone[name]["lane"].endswith("_2")  # quick does not overtake slow


def test_a_placed_vehicle_starts_at_any_speed_up_to_the_limit_in_plain_sumo_too(
    tmp_path: Path,
) -> None:
    placed = tuple(
        PlacedVehicle(name, lane, 50.0, speed, 100.0)
        for lane, (name, speed) in enumerate((("ego", 70.0), ("fast", 55.0), ("fastest", 100.0)))
    )
    fast = ScenarioDescription(speed_limit_m_s=100.0, vehicles=placed, circumference_m=5000.0)
    write_scenario(tmp_path / "fast", fast)
    first = states(tmp_path / "fast", 3)[1]
    speeds = {vehicle.attrib["id"]: float(vehicle.attrib["speed"]) for vehicle in first}
    assert speeds["fastest"] == pytest.approx(100.0, abs=1)
    assert speeds["fast"] == pytest.approx(55.0, abs=1.5)
    assert speeds["ego"] == pytest.approx(70.0, abs=1.5)


def test_in_plain_sumo_the_demo_traffic_keeps_a_low_limit(tmp_path: Path) -> None:
    write_scenario(tmp_path / "slow", ScenarioDescription(speed_limit_m_s=20.0))
    vehicles = states(tmp_path / "slow", 60).iter("vehicle")
    assert max(float(vehicle.attrib["speed"]) for vehicle in vehicles) == 20.0


def test_an_ego_that_is_placed_faster_than_it_may_drive_is_refused(tmp_path: Path) -> None:
    placed = (PlacedVehicle("ego", 0, 50.0, 33.0, 35.0), PlacedVehicle("other", 1, 9.0, 38.0, 38.0))
    write_scenario(tmp_path / "fast", ScenarioDescription(vehicles=placed))
    told = r"ego at 33 m/s, .* ego.max_speed_m_s, 30: place it slow"
    with pytest.raises(ConfigError, match=told):
        HighwayEnv(tmp_path / "fast")
    HighwayEnv(tmp_path / "fast", config={"ego": {"max_speed_m_s": 33.0}}).close()


@pytest.mark.parametrize("name", SHIPPED)
def test_a_comment_in_each_xml_file_says_which_program_reads_it(name: str) -> None:
    files = [path for path in find_scenario(name).iterdir() if path.suffix in (".xml", ".sumocfg")]
    assert len(files) >= 5
    for path in files:
        assert "<!-- " in path.read_text().splitlines()[1]
        own = path.name in ("traffic.rou.xml", "highway.sumocfg")
        assert ("drl-av does not read this file" in path.read_text()) is own


def test_a_scenario_places_at_most_3000_vehicles() -> None:
    # each is compared with all others, and SUMO needs minutes for one step of 9,000
    vehicles = tuple(PlacedVehicle(f"v{n}", 0, 16.0 * n, 20.0, 30.0) for n in range(3001))
    with pytest.raises(ScenarioError, match=r"places 3001 vehicles, but must place at most 3000\."):
        ScenarioDescription(circumference_m=50_000.0, vehicles=vehicles)
