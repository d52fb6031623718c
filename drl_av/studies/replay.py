"""Watching an episode again: recorded, and followed to the last bit."""

import hashlib
import os
import time
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from drl_av.config import Config, from_toml
from drl_av.drawing import Caption, Picture, draw
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.maneuver import Scene
from drl_av.env import HighwayEnv
from drl_av.errors import ConfigError, RecordingError
from drl_av.traffic.ring import FloatArray, Road
from drl_av.traffic.snapshot import Snapshot
from drl_av.video import interpolated, write_video


@dataclass(frozen=True)
class Recording:
    """An episode: what made it, and where every vehicle was at every decision."""

    config: Config
    driver: str
    seed: int
    vehicles: int
    proposed: npt.NDArray[np.int64]
    """Proposed action of each decision, shape (T,)."""
    states: FloatArray
    """Shape (T + 1, 1 + N, 4): s, y, speed and lateral speed, the ego in row 0."""

    def hash(self) -> str:
        """SHA-256 over all positions and speeds."""
        return hashlib.sha256(np.ascontiguousarray(self.states).tobytes()).hexdigest()

    def save(self, path: Path) -> None:
        """Write the recording whole or not at all; raises RecordingError."""
        temporary = path.with_name(path.name + ".tmp")
        try:
            try:
                with temporary.open("wb") as file:
                    np.savez_compressed(
                        file,
                        config=self.config.to_toml(),
                        driver=self.driver,
                        seed=self.seed,
                        vehicles=self.vehicles,
                        proposed=self.proposed,
                        states=self.states,
                    )
                    file.flush()
                    os.fsync(file.fileno())
                os.replace(temporary, path)
            finally:
                temporary.unlink(missing_ok=True)
        except OSError as error:
            raise RecordingError(
                f"The recording {path} cannot be written ({error.strerror}): "
                "free some space or choose another file."
            ) from error


def load_recording(path: Path) -> Recording:
    """Read a recording; raises RecordingError where it is missing, damaged or none."""
    try:
        with np.load(path, allow_pickle=False) as data:
            recording = Recording(
                from_toml(str(data["config"]), name=f"the config in {path}"),
                str(data["driver"]),
                int(data["seed"]),
                int(data["vehicles"]),
                data["proposed"],
                data["states"],
            )
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, ConfigError) as error:
        raise RecordingError(
            f"{path} is no recording, or is damaged ({error}): record the episode again."
        ) from error
    if recording.states.shape != (len(recording.proposed) + 1, recording.vehicles + 1, 4):
        raise RecordingError(f"{path} is damaged, its parts do not fit: record the episode again.")
    return recording


class RecordedDriver:
    """Proposes what was proposed when the episode was recorded."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording

    def start(self, seed: int) -> None:
        """Back to the first decision."""
        self._next: Iterator[int] = iter(self._recording.proposed.tolist())

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The next recorded proposal; raises RecordingError when there is none left."""
        try:
            return ACTIONS[next(self._next)]
        except (StopIteration, IndexError) as error:
            raise RecordingError(
                "The recording ended before the episode did: it was made with another version."
            ) from error


class Recorder:
    """A watcher that remembers an episode."""

    def __init__(self) -> None:
        self._states: list[FloatArray] = []
        self._proposed: list[int] = []

    def __call__(self, env: HighwayEnv) -> None:
        """Remember one decision."""
        self._states.append(states_of(env.scene.snapshot))
        if env.proposed is not None:
            self._proposed.append(env.proposed.number)

    def recording(self, env: HighwayEnv, driver: str) -> Recording:
        """The episode so far."""
        return Recording(
            env.config,
            driver,
            env.seed,
            len(self._states[0]) - 1,
            np.array(self._proposed, dtype=np.int64),
            np.array(self._states),
        )


class Follower:
    """A watcher that compares each decision with a recording; any difference is an error."""

    def __init__(self, recording: Recording) -> None:
        self._expected = iter(recording.states)

    def __call__(self, env: HighwayEnv) -> None:
        """Raises RecordingError at the first position or speed that differs."""
        expected = next(self._expected, None)
        if expected is None or not np.array_equal(states_of(env.scene.snapshot), expected):
            raise RecordingError(
                f"The replay left the recording at decision {env.decisions}: it was made with "
                "another version of SUMO or of this package, or on another platform."
            )


def states_of(snapshot: Snapshot) -> FloatArray:
    """Positions and speeds of all vehicles, shape (1 + N, 4)."""
    return np.stack(
        (snapshot.s_m, snapshot.y_m, snapshot.speed_m_s, snapshot.lateral_speed_m_s), axis=1
    )


class Pacer:
    """A watcher that lets an episode run at ``rate`` times real time in sumo-gui."""

    def __init__(self, rate: float) -> None:
        self._pause_s = 1.0 / rate
        self._next_s: float | None = None

    def __call__(self, env: HighwayEnv) -> None:
        """Sleep until the next decision is due."""
        now = time.monotonic()
        if self._next_s is not None and self._next_s > now:
            time.sleep(self._next_s - now)
        self._next_s = max(now, self._next_s or now) + self._pause_s


class Film:
    """A watcher that keeps what a video needs."""

    def __init__(self, driver: str) -> None:
        self._driver = driver
        self._moments: list[tuple[Snapshot, Caption]] = []
        self._road: Road | None = None

    def __call__(self, env: HighwayEnv) -> None:
        """Remember one decision."""
        self._road = env.road
        self._moments.append((env.scene.snapshot, env.caption))

    def write(
        self, path: Path, fps: int = 20, rate: float = 2.0, told: Callable[[], None] = lambda: None
    ) -> int:
        """Write the video at ``rate`` times real time; returns the number of frames."""
        return write_video(path, self._frames(max(1, round(fps / rate)), told), fps)

    def _frames(self, per_decision: int, told: Callable[[], None]) -> Iterator[Picture]:
        assert self._road is not None
        for (before, _), (after, caption) in zip(self._moments, self._moments[1:], strict=False):
            caption = replace(caption, driver=self._driver)
            for step in range(1, per_decision + 1):
                scene = interpolated(before, after, step / per_decision, self._road)
                yield draw(scene, self._road, caption)
            told()
