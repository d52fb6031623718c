"""A recorded episode comes back to the last bit, or says why it does not."""

import json
import re
import tracemalloc
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drives import hash_of
from PIL import Image
from runs import Capsys, error_message, run_folder

from drl_av.cli import main
from drl_av.config import Config
from drl_av.drivers.registry import load_driver
from drl_av.drivers.rule_based import RandomDriver
from drl_av.errors import RecordingError
from drl_av.evaluation.recording import Recording, load_recording
from drl_av.evaluation.replay import Pacer, ReplaySession, replay_session

SHORT = Config().updated("simulation", decisions_per_episode=12)


@pytest.fixture(scope="module")
def recording() -> Recording:
    session = ReplaySession(SHORT, RandomDriver(), "random", 11, 14)
    return session.drive(None)[0]


@pytest.fixture
def file(recording: Recording, tmp_path: Path) -> Path:
    recording.save(tmp_path / "episode.npz")
    return tmp_path / "episode.npz"


def test_recording_makes_the_round_trip(recording: Recording, file: Path) -> None:
    loaded = load_recording(file)
    assert hash_of(loaded) == hash_of(recording)
    assert (loaded.config, loaded.driver) == (SHORT, "random")
    assert (loaded.seed, loaded.vehicles) == (11, 14)
    np.testing.assert_array_equal(loaded.proposed, recording.proposed)
    assert loaded.states.shape == (13, 15, 4)
    again = file.with_name("again.npz")
    recording.save(again)
    assert again.read_bytes() == file.read_bytes()
    replace(recording, seed=10**20).save(again)  # a seed of any size
    assert load_recording(again).seed == 10**20


def test_replay_is_the_recorded_episode_exactly(recording: Recording, file: Path) -> None:
    ReplaySession(SHORT, RandomDriver(), "random", 12, 30).drive(None)
    again, result = replay_session(load_recording(file)).drive(None)
    assert hash_of(again) == hash_of(recording)
    assert result.decisions == 12


def test_position_that_differs_in_its_last_bit_is_noticed(recording: Recording) -> None:
    states = recording.states.copy()
    states[5, 9, 0] = np.nextafter(states[5, 9, 0], np.inf)
    with pytest.raises(RecordingError, match="differs from the recording at decision 5"):
        replay_session(replace(recording, states=states)).drive(None)


def test_other_actions_leave_the_recording(recording: Recording) -> None:
    accelerate, hard_brake = 1, 3
    other = np.where(recording.proposed == hard_brake, accelerate, hard_brake)
    with pytest.raises(RecordingError, match="differs from the recording at decision 1"):
        replay_session(replace(recording, proposed=other)).drive(None)


def test_recording_that_is_longer_or_shorter_than_the_episode_is_noticed(
    recording: Recording,
) -> None:
    told = {9: "differs from the recording at decision 9", 13: "ends before the episode"}
    for decisions, said in told.items():
        config = SHORT.updated("simulation", decisions_per_episode=decisions)
        with pytest.raises(RecordingError, match=said):
            replay_session(replace(recording, config=config)).drive(None)


def test_tampered_file_is_refused(recording: Recording, file: Path) -> None:
    with np.load(file) as data:
        parts = dict(data)
    parts["seed"] = np.array(12)
    np.savez_compressed(file, **parts)
    with pytest.raises(RecordingError, match="was changed after it was recorded"):
        load_recording(file)


def test_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="There is no recording"):
        load_recording(tmp_path / "missing.npz")
    np.save(tmp_path / "array.npy", np.zeros(3))
    (tmp_path / "text.npz").write_text("hello")
    np.savez(tmp_path / "objects.npz", states=np.array([{}], dtype=object))
    np.savez(tmp_path / "other.npz", states=np.zeros(3))
    for name in ("array.npy", "text.npz", "objects.npz", "other.npz"):
        with pytest.raises(RecordingError, match="is no recording"):
            load_recording(tmp_path / name)


def test_video_is_made_of_a_recording_without_a_screen(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    video = file.with_name("drive.gif")
    assert main(["replay", str(file), "--video", str(video), "--rate", "10"]) == 0
    assert "exactly as recorded, 12 decisions" in capsys.readouterr().out
    with Image.open(video) as film:
        assert film.n_frames == 24
        assert film.size == (1280, 720)


def test_number_of_vehicles_is_the_scenarios_where_it_places_them(tmp_path: Path) -> None:
    from drl_av.scenarios.folder import PlacedVehicle, ScenarioDescription, write_scenario

    placed = (PlacedVehicle("ego", 1, 0.0, 20.0, 30.0), PlacedVehicle("slow", 1, 60.0, 20.0, 20.0))
    write_scenario(tmp_path / "two", ScenarioDescription(vehicles=placed))
    words = ["--scenario", str(tmp_path / "two"), "--decisions", "3", "--record"]
    assert main(["replay", "random", *words, str(tmp_path / "episode.npz")]) == 0
    assert load_recording(tmp_path / "episode.npz").vehicles == 1


def test_pacer_waits_until_the_next_decision_is_due(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, slept = iter([10.0, 10.6, 11.7, 11.8]), []
    monkeypatch.setattr("drl_av.evaluation.replay.time.monotonic", lambda: next(clock))
    monkeypatch.setattr("drl_av.evaluation.replay.time.sleep", slept.append)
    pacer = Pacer(rate=2.0)
    for _ in range(4):
        pacer(None)  # type: ignore[arg-type]
    # due at 10.5 and 11.0; the third came late, at 11.7, so the fourth is due at 12.2
    assert slept == pytest.approx([0.5, 0.4, 0.0, 0.4])


def page_data(file: Path) -> list[dict[str, Any]]:
    """The episodes on a page."""
    [data] = re.findall(r'type="application/json">(.*?)</script>', file.read_text(), flags=re.S)
    found: list[dict[str, Any]] = json.loads(data)["episodes"]
    return found


def test_the_page_of_a_recording_holds_its_places_and_decisions(
    recording: Recording, file: Path, tmp_path: Path, capsys: Capsys
) -> None:
    page = tmp_path / "page.html"
    assert main(["replay", str(file), "--html", str(page)]) == 0
    assert f"{page}: open it in a browser\n" in capsys.readouterr().out
    [data] = page_data(page)
    assert data["title"] == "random, seed 11"
    assert len(data["frames"]) == 13
    places = np.array([frame["s"] for frame in data["frames"]])
    np.testing.assert_allclose(places, recording.states[:, :, 0], atol=0.0051)
    proposed = [decision["proposed"] for decision in data["decisions"]]
    assert proposed == recording.proposed.tolist()
    assert all(decision["values"] is None for decision in data["decisions"])


def test_the_page_marks_each_lane_change_once_where_it_begins(here: Path) -> None:
    words = "gap-mobil --safety-check strict --vehicles 20 --seed 3 --decisions 200"
    assert main(["replay", *words.split(), "--html", "page.html"]) == 0
    [data] = page_data(Path("page.html"))
    marks = [k for k, made in enumerate(data["decisions"]) if made["changes_lane"]]
    y_m = [frame["y"][0] for frame in data["frames"]]
    on_a_lane = [abs(y / 3.8 - round(y / 3.8)) < 0.02 for y in y_m]
    assert marks == [k for k in range(200) if on_a_lane[k] and not on_a_lane[k + 1]]
    assert len(marks) >= 2


@pytest.mark.parametrize(
    ("driver", "are"), [("pretrained-paper", "Q-values"), ("pretrained", "Probabilities")]
)
def test_the_page_of_a_learned_driver_shows_the_values_that_it_chose_by(
    driver: str, are: str, here: Path
) -> None:
    words = ["replay", driver, "--decisions", "8", "--seed", "4", "--html", "page.html"]
    assert main(words) == 0
    [data] = page_data(Path("page.html"))
    assert data["values_are"] == are
    for decision in data["decisions"]:
        assert len(decision["values"]) == 12
        assert max(decision["values"]) == decision["values"][decision["proposed"]]
        if are == "Probabilities":
            assert sum(decision["values"]) == pytest.approx(1.0, abs=1e-5)


def test_two_drivers_meet_the_same_traffic_on_one_page(here: Path, capsys: Capsys) -> None:
    drive = ["--decisions", "3", "--seed", "4", "--vehicles", "9"]
    assert main(["replay", "idm@strict", "--driver", "random", *drive, "--html", "two.html"]) == 0
    said = capsys.readouterr().out
    assert "idm@strict, check strict, 9 vehicles, seed 4: 3 decisions" in said
    assert "random, check paper, 9 vehicles, seed 4: 3 decisions" in said
    one, other = page_data(Path("two.html"))
    assert (one["title"], other["title"]) == ("idm@strict, seed 4", "random, seed 4")
    assert one["frames"][0] == other["frames"][0]
    assert one["frames"][3] != other["frames"][3]
    elsewhere = SHORT.updated("simulation", scenario="/home/ann/circle")
    by_sumo = ReplaySession(elsewhere, load_driver("sumo"), "sumo", 0, 3)
    assert by_sumo.facts == "safety check: none; scenario: circle; world: sumo"
    run_folder(Path("mine"), SHORT.updated("traffic", vehicles_max=12).updated("learning", seed=3))
    for name in ("idm", "random", "mine"):  # on the training of the last no episode depends
        assert main(["replay", name, *drive, "--record", f"{name}.npz"]) == 0
    assert load_recording(Path("mine.npz")).config.learning.seed == 0
    for name in ("mine", "random"):
        assert main(["replay", "idm.npz", f"{name}.npz", "--html", "again.html"]) == 0
    assert page_data(Path("again.html"))[1]["frames"] == other["frames"]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("idm random --record x.npz", "idm and random are no one episode: --html, and no other"),
        ("idm random --html x.html --record x.npz", "idm and random are no one episode"),
        ("idm random gap-mobil --html x.html", "idm and random and gap-mobil are no one episode"),
        ("own.npz idm --html x.html", r"own\.npz and idm are no one episode"),
        ("own.npz other.npz --html x.html", r"These recordings are of other traffic"),
        ("own.npz --observation wide --html x.html", "--observation has no effect on own.npz, wh"),
        ("a.csv b.csv --worst min_ttc_s --html x.html", "--worst takes a table of evaluate"),
    ],
)
def test_what_no_page_can_show_is_one_sentence(
    words: str, why: str, recording: Recording, here: Path, capsys: Capsys
) -> None:
    recording.save(Path("own.npz"))
    replace(recording, seed=12).save(Path("other.npz"))
    assert main(["replay", *words.split()]) == 1
    assert re.fullmatch(f"drl-av: {why}.*\n", capsys.readouterr().err)
    assert not Path("x.html").exists()


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"states": np.zeros(12)}, "states do not have the shape"),
        ({"states": np.zeros((5, 15, 4))}, "numbers of actions and of states differ"),
        ({"proposed": np.array(["keep"] * 12)}, "actions are no row of whole numbers"),
        ({"proposed": np.full(12, 12)}, "an action is not a number from 0 to 11"),
        ({"seed": -1}, "seed or number of vehicles is negative"),
    ],
)
def test_a_recording_of_other_shapes_is_one_sentence(
    changed: dict[str, Any], why: str, recording: Recording, tmp_path: Path, capsys: Capsys
) -> None:
    replace(recording, **changed).save(tmp_path / "odd.npz")  # with a right checksum
    assert main(["replay", str(tmp_path / "odd.npz"), "--html", str(tmp_path / "x.html")]) == 1
    assert why in error_message(capsys)


def test_a_recording_that_expands_without_end_is_refused_before(tmp_path: Path) -> None:
    with (
        zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("states.npy", "w") as part,
    ):
        for _ in range(1001):
            part.write(bytes(10**6))
    tracemalloc.start()
    with pytest.raises(RecordingError, match="it unpacks to more than 1000 MB"):
        load_recording(tmp_path / "bomb.npz")
    assert tracemalloc.get_traced_memory()[1] < 50_000_000
    tracemalloc.stop()


def test_a_name_with_terminal_codes_is_shown_and_not_obeyed(
    recording: Recording, tmp_path: Path, capsys: Capsys
) -> None:
    replace(recording, driver="idm\x1b[2J\x9b31m").save(tmp_path / "episode.npz")
    words = ["replay", str(tmp_path / "episode.npz"), "--html", str(tmp_path / "x.html")]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert r"idm\x1b[2J\x9b31m, check paper, 14 vehicles" in printed
    assert not {"\x1b", "\x9b"} & {*printed}


def test_sumo_does_not_write_over_the_recording_that_it_replays(
    file: Path, here: Path, capsys: Capsys
) -> None:
    before = file.read_bytes()
    page = ["--html", "page.html"]
    for option in (
        f"--summary-output {file}",
        f"--verbose --summary={file.parent}/./episode.npz",
        f"--log-file {file.parent}/.npz --output-prefix episode",
        f"--log-file {file.parents[1]}/.npz --output-prefix {file.parent.name}/episode",
    ):
        assert main(["replay", str(file), "--sumo-options", option, *page]) == 1
        assert "which this command itself reads or writes" in capsys.readouterr().err
    assert main(["replay", "idm", "--sumo-options", "--summary-output page.html", *page]) == 1
    assert "SUMO would write page.html" in capsys.readouterr().err
    Path("more").mkdir()
    named = "".join(f'<edgeData id="{f}" file="{f}"/>' for f in ("page.html", "../it.npz"))
    Path("more/more.xml").write_text(f"<additional>{named}</additional>")
    more = ["--sumo-options", "-a more/more.xml"]
    Path("it.npz").write_bytes(before)
    assert main(["replay", "it.npz", *more, *page]) == 1
    assert "SUMO would write more/../it.npz" in capsys.readouterr().err
    assert main(["replay", str(file), *more, *page]) == 0  # decoy: SUMO writes more/page.html
    assert Path("more", "page.html").exists()
    capsys.readouterr()
    assert main(["evaluate", "idm", "--record", "all", "--sumo-options", "--fcd-output all/a"]) == 1
    assert "SUMO would write all/a" in capsys.readouterr().err
    assert file.read_bytes() == before
    for option in ("--fcd-output a.xml", "--output-prefix a", "--precision 3"):
        assert main(["replay", "idm", "--sumo-options", option, "--fcd", "b.xml"]) == 1
        assert f"--fcd does not go with {option.split()[0]}" in capsys.readouterr().err


def test_a_recording_on_a_road_that_was_moved_is_replayed_there(here: Path, capsys: Capsys) -> None:
    road, page = ["--barricade", "1"], ["--html", "page.html"]
    assert main(["scenario", "mine", *road]) == 0
    own = ["replay", "idm", "--scenario", "mine", "--vehicles", "3", "--decisions", "4"]
    assert main([*own, "--record", "own.npz"]) == 0
    assert main(["replay", "own.npz", "--scenario", "mine", *page]) == 0
    driven = ["idm", "--scenario", "mine", "--vehicles", "3", "--episodes", "1"]
    assert main(["evaluate", *driven, "--out", "own.csv"]) == 0
    worst = ["replay", "own.csv", "--worst", "min_ttc_s", *page]
    Path("mine").rename("moved")
    assert main(worst) == 1
    assert "name the folder in which it is now with --scenario" in capsys.readouterr().err
    assert main([*worst, "--scenario", "moved"]) == 0
    assert main(["replay", "own.npz", *page]) == 1
    assert "or put the folder back there" in capsys.readouterr().err
    assert main(["scenario", "mine"]) == 0
    assert main(["replay", "own.npz", *page]) == 1
    capsys.readouterr()
    assert main(["replay", "own.npz", "--scenario", "moved", *page]) == 0
    assert "exactly as recorded, 4 decisions" in capsys.readouterr().out
    assert main(["scenario", "another"]) == 0
    assert main(["replay", "own.npz", "--scenario", "another", *page]) == 1
    assert "another scenario" in capsys.readouterr().err
    assert main([*worst, "--scenario", "another"]) == 1
    assert "differs from its row" in capsys.readouterr().err
    assert main(["replay", "idm", "--decisions", "2", "--record", "shipped.npz"]) == 0
    assert main(["replay", "shipped.npz", "--scenario", "moved", *page]) == 1
    assert "--scenario cannot be changed in shipped.npz" in capsys.readouterr().err
