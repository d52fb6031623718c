"""``drl_av.RecordVideo``: films with the motion between two decisions, of the chosen episodes."""

import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium
import imageio_ffmpeg
import numpy as np
import pytest
from decisions import decided
from gymnasium.utils.save_video import capped_cubic_video_schedule
from programs import python
from worlds import ROAD, ahead, scene

import drl_av
from drl_av.config import Config
from drl_av.drawing.canvas import EGO_COLOR
from drl_av.env.video import Film, cubic_schedule
from drl_av.errors import ConfigError, RecordingError
from drl_av.road.snapshot import Collision, CollisionKind

CONFIG = Config().updated("simulation", decisions_per_episode=2).updated("traffic", vehicles_max=3)


def highway() -> gymnasium.Env[np.ndarray, np.int64]:
    return gymnasium.make("drl_av/Highway-v0", config=CONFIG)


def pictures(film: Path) -> list[np.ndarray]:
    read = imageio_ffmpeg.read_frames(str(film))
    width, height = next(read)["size"]
    return [np.frombuffer(each, np.uint8).reshape(height, width, 3) for each in read]


def test_a_film_moves_between_two_decisions_and_lasts_as_long_as_the_episode(
    tmp_path: Path,
) -> None:
    env = drl_av.RecordVideo(highway(), tmp_path / "films", lambda episode: episode == 1, fps=10)
    for seed in (1, 2, 3):
        env.reset(seed=seed)
        env.step(np.int64(0))
        assert env.step(np.int64(0))[3]
    env.close()
    [film] = (tmp_path / "films").iterdir()
    assert film.name == "rl-video-episode-1.mp4"
    assert imageio_ffmpeg.count_frames_and_secs(str(film)) == (20, pytest.approx(2.0, abs=0.05))
    road = [picture[60:360].astype(int) for picture in pictures(film)]
    moved = [(abs(b - a) > 60).sum() for a, b in pairwise(road)]
    assert min(moved) > 500


def test_a_film_stays_on_the_contact() -> None:
    film = Film("mine", ROAD, 1)
    for hit in (None, Collision(CollisionKind.HIT_AHEAD, "vehicle1")):
        film.add(decided(after=scene(ahead(30.0)), collision=hit))
    shown = list(film.pictures(per_decision=3))
    assert len(shown) == 2 * 3 + 2 * 3  # two decisions, and the time of two
    assert all(np.array_equal(each, shown[5]) for each in shown[6:])
    coloured = [(each == EGO_COLOR).all(axis=2).sum() for each in shown]
    assert max(coloured[:5]) < coloured[5] / 2  # the word and its field only at the contact
    assert len(list(film.pictures(3, first=2))) == 0


@pytest.mark.parametrize(("rate", "seconds"), [(2.0, 1.5), (3.0, 1.0), (30.0, 0.1)])
def test_a_film_of_three_decisions_is_as_fast_as_asked(
    rate: float, seconds: float, tmp_path: Path
) -> None:
    film, path = Film("mine", ROAD, seed=1), tmp_path / "ride.mp4"
    for _ in range(3):
        film.add(decided(scene(s_m=100.0), scene(s_m=120.0)))
    film.write(path, rate=rate)
    about = next(imageio_ffmpeg.read_frames(str(path)))
    assert about["duration"] == pytest.approx(seconds, abs=0.011)


@pytest.mark.parametrize("end", ["reset", "close"])
def test_an_episode_that_does_not_end_is_written_too(tmp_path: Path, end: str) -> None:
    with drl_av.RecordVideo(highway(), tmp_path, name_prefix="mine", fps=4, rate=2.0) as env:
        env.reset(seed=1)
        env.step(np.int64(0))
        getattr(env, end)()
        assert imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "mine-episode-0.mp4"))[0] == 2
    assert len(list(tmp_path.iterdir())) == 1  # the second episode has no decision


def test_an_environment_is_closed_also_if_its_film_cannot_be_written(tmp_path: Path) -> None:
    class Closing(gymnasium.Wrapper[Any, Any, Any, Any]):
        closed = False

        def close(self) -> None:
            super().close()
            self.closed = True

    inner = Closing(highway())
    env = drl_av.RecordVideo(inner, tmp_path / "films", name_prefix="mine")
    env.reset(seed=1)
    env.step(np.int64(0))
    (tmp_path / "films").rmdir()
    (tmp_path / "films").touch()
    with pytest.raises(RecordingError):
        env.close()
    assert inner.closed


def test_films_of_an_earlier_run_are_overwritten_with_a_warning(tmp_path: Path) -> None:
    folder = tmp_path / "100%"
    folder.mkdir()
    (folder / "a[b]-episode-0.mp4").touch()
    with pytest.warns(UserWarning, match="in .*100% may be overwritten: name another video_folder"):
        drl_av.RecordVideo(highway(), folder, name_prefix="a[b]")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drl_av.RecordVideo(highway(), folder)  # of another prefix


def test_a_film_needs_no_moviepy_and_the_default_films_the_episodes_that_gymnasium_films(
    tmp_path: Path,
) -> None:
    program = """
import sys
import gymnasium
sys.modules["moviepy"] = None  # importing it fails, as where it is not installed
import drl_av
env = drl_av.RecordVideo(gymnasium.make("drl_av/Highway-v0"), "films")
env.reset(seed=1)
env.step(0)
env.close()
"""
    python("-c", program, cwd=tmp_path)
    assert (tmp_path / "films" / "rl-video-episode-0.mp4").stat().st_size > 1000
    filmed = [episode for episode in range(5000) if cubic_schedule(episode)]
    assert filmed == [n**3 for n in range(10)] + [1000, 2000, 3000, 4000]
    assert filmed == [n for n in range(5000) if capped_cubic_video_schedule(n)]


def test_another_environment_and_an_impossible_film_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"not .*CartPole.*: take gymnasium's"):
        drl_av.RecordVideo(gymnasium.make("CartPole-v1"), tmp_path)  # type: ignore[arg-type]
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"fps": 0}, "fps is 0, but must be a number above 0"),
        ({"fps": "fast"}, "fps is 'fast', but must be a number above 0"),
        ({"rate": 0.0}, "rate is 0.0, but must be a number above 0"),
        ({"rate": float("nan")}, "rate is nan, but must be a number above 0"),
        ({"episode_trigger": True}, "episode_trigger is True, but must be a function"),
    ]
    for arguments, message in wrong:
        with pytest.raises(ConfigError, match=message):
            drl_av.RecordVideo(highway(), tmp_path, **arguments)
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match=r"file cannot be made \(File exists\): name another"):
        drl_av.RecordVideo(highway(), tmp_path / "file")


def test_a_step_before_the_first_reset_asks_for_a_reset(tmp_path: Path) -> None:
    with pytest.raises(gymnasium.error.ResetNeeded):
        drl_av.RecordVideo(highway().unwrapped, tmp_path).step(np.int64(0))
