"""The user's own SUMO files and options: what a folder may hold, and what only the user may say."""

import gzip
import re
import xml.etree.ElementTree as ET
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium
import pytest
from runs import SHORT, Capsys, error_message

from drl_av.cli import main
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ConfigError, DrlAvError, ScenarioError, SimulationError
from drl_av.scenarios.folder import load_scenario

LOOP = '<inductionLoop id="loop" lane="e0_1" pos="50" period="1" file="{}"/>'
MOVES = 'accel="1.5" decel="4" emergencyDecel="4" maxSpeedLat="0.76" carFollowModel="IDM"'
TYPES = f"""<vTypeDistribution id="mine">
  <vType id="long" length="16" width="2.5" probability="1" maxSpeed="20" {MOVES}/>
  <vType id="short" length="4" width="1.7" probability="3" maxSpeed="40" {MOVES}/>
</vTypeDistribution>"""


def own_file(*elements: str, name: str = "mine.add.xml") -> None:
    Path(name).write_text(f"<additional>{''.join(elements)}</additional>")


def write(folder: str = "road") -> int:
    Path("mine.toml").write_text('additional_files = ["mine.add.xml"]\n')
    return main(["scenario", folder, "--from", "mine.toml"])


def test_a_scenario_carries_detectors_and_types_of_the_user(here: Path) -> None:
    own_file(LOOP.format("NUL"), TYPES)
    assert write() == 0
    assert load_scenario("road").as_written
    counted = Counter[str]()
    with closing(HighwayEnv(scenario="./road", config=SHORT)) as env:
        for seed in range(20):
            env.reset(seed=seed, options={"vehicles": 10})
            counted.update(env.simulation.fleet.type_ids[1:])
            lengths_m = set(env.scene.snapshot.length_m[1:].tolist())
            assert lengths_m <= {16.0, 4.0}
        passed = 0
        for _ in range(10):
            env.execute(0)
            passed += env.simulation._sumo.inductionloop.getLastIntervalVehicleNumber("loop")
        assert passed > 0
    assert counted.keys() == {"long", "short"}
    assert 35 <= counted["long"] <= 65  # a quarter of 200: 50, and 2.4 standard deviations
    own_file(LOOP.format("NUL").replace("pos", "position"))
    assert write("wrong") == 0  # what SUMO refuses
    env = HighwayEnv(scenario="./wrong")
    told = r"SUMO cannot load the scenario.*: correct its additional_files, write it again"
    with pytest.raises(SimulationError, match=told):
        env.reset(seed=0)


def test_strict_takes_types_with_shares(here: Path) -> None:
    like_ours = 'laneChangeModel="SL2015" lcAccelLat="1000" lcKeepRight="0" minGap="2.5"'
    own_file(TYPES.replace(MOVES, f'{MOVES} {like_ours} speedFactor="1" speedDev="0"'))
    assert write() == 0
    with closing(HighwayEnv(scenario="./road", safety_check="strict", config=SHORT)) as env:
        env.reset(seed=0, options={"vehicles": 10})
        assert {*env.simulation.fleet.type_ids[1:]} == {"long", "short"}


@pytest.mark.parametrize(
    ("element", "said"),
    [
        (LOOP.format("/tmp/overwritten.xml"), "its <inductionLoop> names a file by the attribute"),
        ('<vehicle id="v" depart="0"/>', "it has an element <vehicle>"),
        ('<rerouter id="r" edges="e0" file="NUL"/>', "it has an element <rerouter>"),
        (TYPES.replace(' decel="4"', ""), "has decel None"),
        (TYPES.replace('id="mine"', 'id="mine" vTypes="traffic"'), "has vTypes, but must have its"),
        (TYPES.replace('length="16"', ""), "a vType has no length: add it"),
        (TYPES.replace("IDM", "EIDM"), "car_following_model is 'EIDM'"),
        (TYPES.replace('probability="3"', 'probability="many"'), "'short' has probability 'many'"),
    ],
)
def test_a_file_of_a_scenario_that_is_unsafe_or_wrong_is_one_sentence(
    element: str, said: str, here: Path, capsys: Capsys
) -> None:
    own_file(LOOP.format("NUL"), TYPES)
    assert write() == 0
    own_file(element, name="road/mine.add.xml")
    words = ["replay", "--driver", "idm", "--scenario", "road", "--record", "e.npz"]
    assert main(words) == 1
    assert said in error_message(capsys)
    assert not Path("/tmp/overwritten.xml").exists()


@pytest.mark.parametrize(
    ("stated", "wrong", "said"),
    [
        ('accel="1.5"', 'accel="x"', "has accel 'x', but must have a number: correct it."),
        ('decel="4"', 'decel="x"', "has decel 'x', but must have a number above 0."),
        ('maxSpeed="20"', 'maxSpeed="200"', "top_speed_m_s is 200.0, but must be a number from"),
    ],
)
def test_a_wrong_number_of_a_type_is_named_when_the_scenario_is_written(
    stated: str, wrong: str, said: str, here: Path, capsys: Capsys
) -> None:
    own_file(TYPES.replace(stated, wrong, 1))
    assert write() == 1
    line = error_message(capsys)
    assert re.match("drl-av: mine.add.xml: .*ehicle type 'long'", line)
    assert said in line
    assert not Path("road").exists()


@pytest.mark.parametrize(
    "names", [["../mine.add.xml"], ["/etc/mine.add.xml"], ["a,b.add.xml"], [""], "mine.add.xml"]
)
def test_a_scenario_names_files_of_its_own_folder_only(names: object, here: Path) -> None:
    assert main(["scenario", "road"]) == 0
    Path("road/SHA256SUMS").unlink()
    Path("road/scenario.toml").write_text(f"additional_files = {names!r}\n")
    with pytest.raises(ScenarioError, match="names of files in the same folder"):
        load_scenario("road")


@pytest.mark.parametrize("names", [["view.xml"], ["two.add.xml", "two.add.xml"]])
def test_a_file_with_the_name_of_another_is_not_written_over_it(
    names: list[str], here: Path, capsys: Capsys
) -> None:
    own_file(TYPES, name=names[0])
    Path("mine.toml").write_text(f"additional_files = {names}\n")
    assert main(["scenario", "road", "--from", "mine.toml"]) == 1
    assert f"The scenario has a file {names[0]} already: rename yours" in error_message(capsys)
    assert not Path("road").exists()


def test_a_file_that_only_sumo_loads_is_named(here: Path) -> None:
    assert main(["scenario", "road"]) == 0
    settings = Path("road/highway.sumocfg")
    settings.write_text(settings.read_text().replace(".add.xml", ".add.xml,detectors.add.xml"))
    with pytest.raises(ScenarioError, match="was changed after it was written"):
        load_scenario("road")
    Path("road/SHA256SUMS").unlink()
    with pytest.raises(ScenarioError, match=r'write additional_files = \["detectors.add.xml"\]'):
        load_scenario("road")
    own_file(LOOP.format("NUL"), name="road/detectors.add.xml")
    with Path("road/scenario.toml").open("r+") as file:
        text = file.read()
        file.seek(0)
        file.write(f'additional_files = ["detectors.add.xml"]\n{text}')
    assert load_scenario("road").additional_files[-1] == here / "road" / "detectors.add.xml"


def test_what_the_user_says_himself_may_write_files(here: Path) -> None:
    own_file(LOOP.format("passed.xml"), '<vTypeDistribution id="mix" vTypes="slow"/>')
    own_file('<vType id="slow"/>', name="slow.add.xml")  # which SUMO must read first
    options = "-a slow.add.xml --additional-files=mine.add.xml --device.ssm.probability 1"
    options += " --device.ssm.file ssm.xml --fcd-output fcd.xml"
    with gymnasium.make("drl_av/Highway-v0", config=SHORT, sumo_options=options) as env:
        for seed in (4, 5):
            env.reset(seed=seed, options={"vehicles": 20})
            over, decisions = False, 0
            while not over:
                *_, terminated, truncated, _ = env.step(0)
                over, decisions = terminated or truncated, decisions + 1
    passed = [int(each.get("nVehContrib", "")) for each in ET.parse("passed.xml").iter("interval")]
    assert sum(passed) > 0
    times_s = [float(each.get("time", "")) for each in ET.parse("fcd.xml").iter("timestep")]
    assert times_s == [0.5 * step for step in range(2 * decisions)]  # of the last episode alone
    egos = {each.get("ego") for each in ET.parse("ssm.xml").iter("conflict")}
    assert "ego" in egos


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--step-length 0.1", "sumo_options has step-length, which drl-av sets itself"),
        (["--net-file=mine.net.xml"], "sumo_options has net-file"),
        ("-c mine.sumocfg", "sumo_options has c,"),
        ("--remote-port 8899", "sumo_options has remote-port, which drl-av sets itself: leave it"),
        ("--num-clients=2", "sumo_options has num-clients"),
        ("-r mine.rou.xml", "sumo_options has -r, but drl-av places the vehicles"),
        ("-g my.view.xml", "sumo_options has g, which drl-av sets itself"),
        ("--start", "sumo_options has start, which drl-av sets itself"),
        ("--routes mine.rou.xml", "drive with drl_av.attach"),
        ("--fcd-output 'fcd.xml", "close its quotation mark"),
        ("--fcd-outptu fcd.xml", "correct sumo_options"),
        (3, "sumo_options is 3, but must be a text, such as '--fcd-output fcd.xml', or a list of"),
        (["--fcd-output", 3], r"sumo_options is \['--fcd-output', 3\], but must be a text"),
    ],
)
def test_an_option_that_cannot_be_is_one_sentence(options: Any, said: str) -> None:
    with pytest.raises(DrlAvError, match=said) as raised:  # noqa: SIM117
        with closing(HighwayEnv(sumo_options=options)) as env:
            env.reset(seed=0, options={"vehicles": 1})
    assert isinstance(raised.value, ConfigError if said[:7] != "correct" else SimulationError)


@pytest.mark.parametrize("name", ["step-method.ballistic", "default.action-step-length"])
def test_an_option_that_changes_how_vehicles_drive_is_refused_under_strict(name: str) -> None:
    with pytest.raises(ConfigError, match=f"Under the check strict .* not have --{name}, because"):
        HighwayEnv(safety_check="strict", sumo_options=f"--{name}=1")
    HighwayEnv(safety_check="paper", sumo_options=f"--{name}=1").close()


@pytest.mark.parametrize(
    ("element", "sentence"),
    [
        ('<vehicle id="i" depart="0" route="x"/>', "<vehicle>, a vehicle or a person that the ego"),
        ('<calibrator id="c" lane="e0_0" pos="1"><flow begin="0" end="9"/></calibrator>', "<flow>"),
        (
            '<variableSpeedSign id="v" lanes="e0_0"><step time="0" speed="9"/></variableSpeedSign>',
            "<variableSpeedSign>, a speed limit that the ego does not see: leave it out, or drive",
        ),
        ('<rerouter id="r" edges="e0"/>', "<rerouter>, closed lanes or new routes"),
        ('<vaporizer id="e0" begin="0" end="9"/>', "<vaporizer>, a place where vehicles vanish"),
    ],
)
def test_a_file_that_adds_what_the_ego_does_not_see_is_refused(
    here: Path, element: str, sentence: str
) -> None:
    (here / "empty.add.xml").write_text('<additional><poi id="p" x="0" y="0"/></additional>')
    (here / "more.add.xml").write_text(f"<additional>{element}</additional>")
    with pytest.raises(ConfigError, match=r"The additional file more\.add\.xml has " + sentence):
        HighwayEnv(sumo_options="-a empty.add.xml,more.add.xml")
    HighwayEnv(sumo_options="-a empty.add.xml").close()


@pytest.mark.parametrize("element", ["vehicle", "variableSpeedSign"])
def test_a_compressed_file_is_refused_once_sumo_has_read_it(here: Path, element: str) -> None:
    within = '<route edges="e0"/>' if element == "vehicle" else '<step time="0" speed="9"/>'
    text = (
        f'<additional><{element} id="i" depart="99" lanes="e0_0">{within}</{element}></additional>'
    )
    (here / "more.add.xml.gz").write_bytes(gzip.compress(text.encode()))
    said = r"SUMO has loaded .*, which the ego does not see"
    with (
        closing(HighwayEnv(sumo_options="-a more.add.xml.gz")) as env,
        pytest.raises(ConfigError, match=said),
    ):
        env.reset(seed=0, options={"vehicles": 1})
