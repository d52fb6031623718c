"""sumo-gui on a virtual screen; Xvfb must be there: these tests fail without it, never skip."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drl_av.config import Config
from drl_av.drawing.sheet import EGO_COLOR, speed_color
from drl_av.drivers.rules import IdmSumoDriver
from drl_av.evaluation.recording import Recording
from drl_av.evaluation.replay import ReplaySession

WATCH = """
import json, sys, time
from pathlib import Path
import traci
from drl_av.evaluation.recording import load_recording
from drl_av.evaluation.replay import replay_session
recording, shown = load_recording(Path(sys.argv[1])), []

def width():
    (left, _), (right, _) = traci.gui.getBoundary("View #0")
    return right - left

decisions = 0

def watch(decision):
    global decisions
    decisions += 1
    gui, patience_s = traci.gui, time.monotonic() + 10
    time.sleep(0.2)
    while width() > 230 and time.monotonic() < patience_s:
        time.sleep(0.1)  # a busy machine draws later
    if decisions == 5:
        gui.screenshot("View #0", sys.argv[2])
    shown.append({
        "tracked": gui.getTrackedVehicle("View #0"),
        "caption": traci.poi.getParameter("caption", "caption"),
        "caption_at": traci.poi.getPosition("caption"),
        "heading": traci.vehicle.getAngle("ego"),
        "turned": gui.getAngle("View #0"),
        "colors": {name: traci.vehicle.getColor(name)[:3] for name in traci.vehicle.getIDList()},
        "speeds": {name: traci.vehicle.getSpeed(name) for name in traci.vehicle.getIDList()},
        "box": gui.getBoundary("View #0"),
        "ego": traci.vehicle.getPosition("ego"),
    })

again, result = replay_session(recording).drive("human", watch)
print(json.dumps({"hash": again.hash(), "decisions": shown}))
"""


def environment(screen: str | None) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    shown = {"DISPLAY": screen, "LIBGL_ALWAYS_SOFTWARE": "1"} if screen else {}
    return kept | shown


def run(screen: str | None, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        env=environment(screen),
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.fixture(scope="module")
def recording() -> Recording:
    config = Config().updated("simulation", decisions_per_episode=10)
    return ReplaySession(config, IdmSumoDriver(config.safety), "idm-sumo", 4, 30).drive(None)[0]


@pytest.fixture(scope="module")
def folder(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("gui")
    recording.save(folder / "episode.npz")
    return folder


@pytest.fixture(scope="module")
def watched(screen: str, folder: Path) -> dict:  # type: ignore[type-arg]
    """What sumo-gui shown while it replayed the recording."""
    picture = str(folder / "sumo_gui.png")
    ended = run(screen, "-c", WATCH, str(folder / "episode.npz"), picture)
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout.splitlines()[-1])  # type: ignore[no-any-return]


def test_replay_in_sumo_gui_is_the_headless_episode_to_the_last_bit(
    watched: dict,
    recording: Recording,  # type: ignore[type-arg]
) -> None:
    assert watched["hash"] == recording.hash()
    assert len(watched["decisions"]) == 10


def test_ego_is_followed_with_about_200_m_of_road_around_it(watched: dict) -> None:  # type: ignore[type-arg]
    for decision in watched["decisions"]:
        (left, low), (right, high) = decision["box"]
        x, y = decision["ego"]
        assert decision["tracked"] == "ego"
        assert 190 < right - left < 230
        assert left < x < right
        assert low < y < high


def test_the_ego_drives_to_the_right_and_the_caption_is_beside_the_road(watched: dict) -> None:  # type: ignore[type-arg]
    for decision in watched["decisions"]:
        (_, low), (_, high) = decision["box"]
        (x, y), (caption_x, caption_y) = decision["ego"], decision["caption_at"]
        assert (decision["heading"] - 90 - decision["turned"]) % 360 == pytest.approx(0, abs=1e-3)
        away = math.hypot(caption_x - x, caption_y - y)
        assert away == pytest.approx(0.42 * (high - low), abs=1)
        # on the outer side of the loop, around the origin
        assert math.hypot(caption_x, caption_y) == pytest.approx(math.hypot(x, y) + away, abs=2)


def test_vehicles_have_the_colours_of_the_film(watched: dict) -> None:  # type: ignore[type-arg]
    for decision in watched["decisions"]:
        assert tuple(decision["colors"].pop("ego")) == EGO_COLOR
        for name, color in decision["colors"].items():
            assert tuple(color) == speed_color(decision["speeds"][name])


def test_caption_shows_decision_rule_speed_and_reward(watched: dict) -> None:  # type: ignore[type-arg]
    for decision in watched["decisions"]:
        for word in ("rule: ", "m/s", "reward -"):
            assert word in decision["caption"]


def test_screenshot_shows_road_vehicles_and_caption(watched: dict, folder: Path) -> None:  # type: ignore[type-arg]
    with Image.open(folder / "sumo_gui.png") as picture:
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
        assert share[name].sum() > 50, name


def test_command_replays_a_recording_in_sumo_gui(screen: str, folder: Path) -> None:
    words = ("-m", "drl_av", "replay", str(folder / "episode.npz"), "--gui", "--rate", "50")
    ended = run(screen, *words)
    assert (ended.returncode, "exactly as recorded" in ended.stdout) == (0, True), ended.stderr


@pytest.mark.parametrize("display", [None, ":987"])
def test_without_a_screen_one_sentence_and_the_interpreter_lives(
    display: str | None, folder: Path
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
