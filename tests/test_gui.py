"""sumo-gui on a virtual screen; Xvfb must be there: these tests fail without it, never skip."""

import ast
import json
import math
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drives import hash_of
from PIL import Image
from programs import python
from shown import ROOT

from drl_av.config import Config
from drl_av.drawing.canvas import EGO_COLOR, speed_color
from drl_av.drivers.rule_based import IdmSumoDriver
from drl_av.evaluation.recording import Recording
from drl_av.evaluation.replay import ReplaySession
from drl_av.scenarios.folder import PlacedVehicle, write_scenario
from drl_av.scenarios.highways import MergeDescription

WATCH = """
import json, sys, time
from hashlib import sha256
from pathlib import Path
import traci
from drl_av.evaluation.recording import load_recording
from drl_av.evaluation.replay import replay_session
recording, shown = load_recording(Path(sys.argv[1])), []

decisions = 0

def watch(decision):
    global decisions
    decisions += 1
    gui = traci.gui
    time.sleep(0.2)
    if decisions == 5:
        gui.screenshot("View #0", sys.argv[2])
    shown.append({
        "caption": traci.poi.getParameter("caption", "caption"),
        "caption_at": traci.poi.getPosition("caption"),
        "heading": traci.vehicle.getAngle("ego"),
        "turned": gui.getAngle("View #0"),
        "colors": {name: traci.vehicle.getColor(name)[:3] for name in traci.vehicle.getIDList()},
        "speeds": {name: traci.vehicle.getSpeed(name) for name in traci.vehicle.getIDList()},
        "box": gui.getBoundary("View #0"),
        "places": {name: traci.vehicle.getPosition(name) for name in traci.vehicle.getIDList()},
    })

again, result = replay_session(recording).drive("human", watch)
print(json.dumps({"hash": sha256(again.states.tobytes()).hexdigest(), "decisions": shown}))
"""


def run(screen: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return python(*arguments, DISPLAY=screen, LIBGL_ALWAYS_SOFTWARE="1")


def recorded(scenario: str, vehicles: int, decisions: int) -> Recording:
    config = Config().updated("simulation", scenario=scenario, decisions_per_episode=decisions)
    session = ReplaySession(config, IdmSumoDriver(config.safety), "idm-sumo", 4, vehicles)
    return session.drive(None)[0]


@pytest.fixture(scope="module")
def recording() -> Recording:
    return recorded("circular_three_lane", 30, 10)


@pytest.fixture(scope="module")
def folder(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("gui")
    recording.save(folder / "episode.npz")
    return folder


def watch(screen: str, episode: Path) -> dict[str, Any]:
    """What sumo-gui shows while it replays a recording; a screenshot is beside that."""
    ended = run(screen, "-c", WATCH, str(episode), str(episode.with_suffix(".png")))
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout.splitlines()[-1])  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def watched(screen: str, folder: Path) -> dict[str, Any]:
    return watch(screen, folder / "episode.npz")


def in_window(decision: dict[str, Any], place: tuple[float, float]) -> tuple[float, float]:
    """Right of the window's middle and above it, each as a share of half of the window."""
    (left, low), (right, high) = decision["box"]
    x, y = place[0] - (left + right) / 2, place[1] - (low + high) / 2
    turned = math.radians(decision["turned"])
    along = x * math.cos(turned) - y * math.sin(turned)
    above = x * math.sin(turned) + y * math.cos(turned)
    return along / (right - left) * 2, above / (high - low) * 2


def is_shown(decision: dict[str, Any], place: tuple[float, float]) -> bool:
    return max(map(abs, in_window(decision, place))) < 1


def test_replay_in_sumo_gui_is_the_headless_episode_to_the_last_bit(
    watched: dict[str, Any], recording: Recording
) -> None:
    assert watched["hash"] == hash_of(recording)
    assert len(watched["decisions"]) == 10


def test_the_ego_drives_to_the_right_with_200_m_of_the_loop_ahead_of_it_in_view(
    watched: dict[str, Any],
) -> None:
    for decision in watched["decisions"]:
        places = decision["places"]
        assert (decision["heading"] - 90 - decision["turned"]) % 360 == pytest.approx(0, abs=1e-3)
        # the loop of 500 m has its centre at the origin, and vehicles drive to the left around it
        phase = {name: math.atan2(y, x) for name, (x, y) in places.items()}
        ahead_m = {
            name: (own - phase["ego"]) % math.tau / math.tau * 500 for name, own in phase.items()
        }
        near = [name for name, distance_m in ahead_m.items() if distance_m < 200]
        assert len(near) > 5
        assert all(is_shown(decision, places[name]) for name in near)


def test_the_caption_is_below_the_ego_and_beside_the_road_and_colours_are_those_of_the_film(
    watched: dict[str, Any],
) -> None:
    for decision in watched["decisions"]:
        assert all(word in decision["caption"] for word in ("rule: ", "m/s", "reward -"))
        colors = {name: tuple(color) for name, color in decision["colors"].items()}
        speeds = {name: speed_color(speed) for name, speed in decision["speeds"].items()}
        assert colors == speeds | {"ego": EGO_COLOR}
        ego, caption = decision["places"]["ego"], decision["caption_at"]
        assert is_shown(decision, caption)
        assert in_window(decision, caption)[1] < in_window(decision, ego)[1] - 0.1
        assert math.hypot(*caption) > 500 / math.tau + 5  # the right lane is less than 4 m wide


@pytest.mark.parametrize("placed", [(), (PlacedVehicle("ego", 1, 20.0, 20.0, 30.0),)])
def test_an_open_road_is_in_view_from_50_m_behind_the_ego_to_200_m_ahead_of_it(
    placed: tuple[PlacedVehicle, ...], screen: str, tmp_path: Path
) -> None:
    write_scenario(tmp_path / "merge", MergeDescription(vehicles=placed))
    recorded(str(tmp_path / "merge"), 0 if placed else 20, 8).save(tmp_path / "merge.npz")
    decisions = watch(screen, tmp_path / "merge.npz")["decisions"]
    assert len(decisions) == 8
    for decision in decisions:
        x, y = decision["places"]["ego"]  # the highway leads along x
        assert all(is_shown(decision, (max(x + far, 0.0), y)) for far in (-45, 0, 195))
        assert is_shown(decision, decision["caption_at"])
        (left, _), (right, _) = decision["box"]
        assert right - left < 300


ALONE = """
import sys, time
import traci
from drl_av.sumo_programs import program
plain = [str(program("sumo-gui")), "-c", sys.argv[1], "--start", "--quit-on-end", "--delay", "0"]
traci.start([*plain, "--window-size", "1200,800"])
while traci.simulation.getTime() < 70:
    traci.simulationStep()
traci.gui.screenshot("View #0", sys.argv[2])
traci.simulationStep()
print(traci.gui.getBoundary("View #0"))
traci.close()
"""


def test_plain_sumo_gui_opens_a_ramp_where_vehicles_join_and_are_seen(
    screen: str, tmp_path: Path
) -> None:
    opened = str(ROOT / "sumo_scenarios" / "merge" / "highway.sumocfg")
    picture = tmp_path / "merge.png"
    ended = run(screen, "-c", ALONE, opened, str(picture))
    (west, south), (east, north) = ast.literal_eval(ended.stdout.splitlines()[-1])
    assert west < 500 < 750 < east  # the acceleration lane, of a road of 1,750 m
    assert south < -9.5 < north
    pixels = np.asarray(Image.open(picture).convert("RGB")).reshape(-1, 3).astype(int)
    yellow = ((pixels - (240, 190, 40)) ** 2).sum(1) < 3000
    assert yellow.sum() > 300  # 96 where the window shows the whole road


def test_screenshot_shows_road_vehicles_and_caption(watched: dict[str, Any], folder: Path) -> None:
    with Image.open(folder / "episode.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(int)
    share = {
        "grass": ((pixels - (51, 128, 51)) ** 2).sum(1) < 600,
        "road": pixels.max(1) < 30,
        "ego": ((pixels - EGO_COLOR) ** 2).sum(1) < 3000,
        "letters": pixels.min(1) > 240,
    }
    assert share["grass"].mean() > 0.2
    assert share["road"].mean() > 0.05
    for name in ("ego", "letters"):
        assert share[name].sum() > 25, name


def test_command_replays_a_recording_in_sumo_gui(screen: str, folder: Path) -> None:
    words = ("-m", "drl_av", "replay", str(folder / "episode.npz"), "--gui", "--rate", "50")
    ended = run(screen, *words)
    assert (ended.returncode, "exactly as recorded" in ended.stdout) == (0, True), ended.stderr


@pytest.mark.parametrize("display", ["", ":987"])
def test_without_a_screen_one_sentence_and_the_interpreter_lives(
    display: str, folder: Path
) -> None:
    words = "['replay', sys.argv[1], '--gui']"
    program = f"import sys; from drl_av.cli import main; print('status', main({words}))"
    ended = run(display, "-c", program, str(folder / "episode.npz"))
    assert ended.stdout == "status 1\n"
    assert ended.stderr.startswith("drl-av: sumo-gui has no screen to open on: set DISPLAY")
    assert ended.stderr.count("\n") == 1


CHECK = """
import gymnasium, warnings
from gymnasium.utils.env_checker import check_env
warnings.simplefilter("error", UserWarning)
import drl_av
env = gymnasium.make("drl_av/Highway-v0", disable_env_checker=True)
check_env(env.unwrapped)
env.close()
human = gymnasium.make("drl_av/Highway-v0", render_mode="human")
for seed in (1, 2):
    human.reset(seed=seed, options={"vehicles": 2})
    human.step(0)
human.close()
print("checked")
"""


def test_environment_passes_gymnasium_s_check_with_its_window_and_opens_it_again(
    screen: str,
) -> None:
    ended = run(screen, "-c", CHECK)
    assert (ended.returncode, ended.stdout) == (0, "checked\n"), ended.stderr
