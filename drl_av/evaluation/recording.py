"""Records an episode to a file, reads such a file, and compares a replay with it exactly."""

import hashlib
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np
import numpy.typing as npt

from drl_av.config import Config, from_toml
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene
from drl_av.env.transition import Transition
from drl_av.errors import RecordingError
from drl_av.files import write_atomic
from drl_av.road.road import FloatArray
from drl_av.road.snapshot import Snapshot
from drl_av.simulation.vehicle_calls import EgoModel


@dataclass(frozen=True)
class Recording:
    """A recorded episode of T decisions: settings, seed, and all vehicles at each decision."""

    config: Config
    driver: str
    seed: int
    vehicles: int
    proposed: npt.NDArray[np.int64]
    """Number of the proposed action of each decision, shape (T,)."""
    states: FloatArray
    """Shape (T + 1, 1 + N, 4): s, y, speed and lateral speed of each vehicle, SI, the ego first.

    On an open road, N counts each vehicle that was on the road at any decision. The states of a
    vehicle are NaN while it is not on the road.
    """
    ego_model: EgoModel | None = None
    """The parameters of SUMO's models, if they drove the ego; None if the driver's actions did."""

    def hash(self) -> str:
        """Return the SHA-256, in hex, of all positions and speeds."""
        return hashlib.sha256(np.ascontiguousarray(self.states).tobytes()).hexdigest()

    def save(self, path: Path) -> None:
        """Write the recording to a .npz file atomically; raises DrlAvError if the write fails."""
        parts: dict[str, Any] = {
            "config": np.array(self.config.to_toml()),
            "driver": np.array(self.driver),
            "seed": np.array(str(self.seed)),  # of any size
            "vehicles": np.array(self.vehicles),
            "proposed": self.proposed,
            "states": self.states,
        }
        if self.ego_model is not None:
            parts["ego_model"] = np.array(self.ego_model, dtype=np.float64)
        data = io.BytesIO()
        np.savez_compressed(data, **parts, sha256=np.array(_checksum(parts)))
        write_atomic(path, data.getvalue())


def _checksum(parts: Mapping[str, npt.NDArray[Any]]) -> str:
    digest = hashlib.sha256()
    for name in sorted(parts):
        digest.update(repr((name, parts[name].dtype.str, parts[name].shape)).encode())
        digest.update(np.ascontiguousarray(parts[name]).tobytes())
    return digest.hexdigest()


def _ego_model(numbers: FloatArray) -> EgoModel:
    headway_s, assertiveness, speed_gain, overtake_right = numbers.tolist()
    return EgoModel(headway_s, assertiveness, speed_gain, bool(overtake_right))


def load_recording(path: Path) -> Recording:
    """Read a recording; raises RecordingError if it is missing, damaged or another kind of file."""
    if not path.is_file():
        raise RecordingError(f"There is no recording {path}: check the path.")
    if not is_zipfile(path):
        raise RecordingError(
            f"{path} is no recording, or is cut short: give a file that drl-av replay --record "
            "wrote."
        )
    try:
        with np.load(path, allow_pickle=False) as data:
            parts = dict(data)
        expected = str(parts.pop("sha256"))
        recording = Recording(
            from_toml(str(parts["config"]), name="its config"),
            str(parts["driver"]),
            int(parts["seed"]),
            int(parts["vehicles"]),
            parts["proposed"],
            parts["states"],
            _ego_model(parts["ego_model"]) if "ego_model" in parts else None,
        )
    except Exception as error:  # the readers of zip, zlib and npy raise many classes
        raise RecordingError(
            f"{path} is no recording of this version, or is damaged "
            f"({str(error).rstrip('.') or type(error).__name__}): record the episode again."
        ) from error
    if _checksum(parts) != expected:
        raise RecordingError(
            f"{path} was changed after it was recorded, its checksum does not match: "
            "record the episode again."
        )
    return recording


class RecordedDriver:
    """A driver that proposes the actions of a recording in their order."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording

    def start(self, seed: int) -> None:
        """Start again with the first recorded action; ``seed`` is not used."""
        self._next: Iterator[int] = iter(self._recording.proposed.tolist())

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the next recorded proposal; raises RecordingError after the last one."""
        try:
            return ACTIONS[next(self._next)]
        except (StopIteration, IndexError) as error:
            raise RecordingError(
                "The recording ends before the episode: it was made with another version."
            ) from error


class Recorder:
    """Records an episode, decision by decision."""

    def __init__(self) -> None:
        self._vehicles = 0
        self._proposed: list[int] = []
        self._moments: list[Snapshot] = []

    def add(self, decision: Transition) -> None:
        """Record the next decision of the episode."""
        if not self._proposed:
            self._moments.append(decision.scene.snapshot)
            self._vehicles = len(decision.scene.snapshot.ids) - 1
        self._moments.append(decision.next_scene.snapshot)
        self._proposed.append(decision.proposed.number)

    def recording(
        self, config: Config, driver: str, seed: int, ego_model: EgoModel | None = None
    ) -> Recording:
        """Return the recording of the episode so far, with the settings that determine it."""
        return Recording(
            config,
            driver,
            seed,
            self._vehicles,
            np.array(self._proposed, dtype=np.int64),
            self._states(),
            ego_model,
        )

    def _states(self) -> FloatArray:
        """Return the states in the form of ``Recording.states``, shape (moments, vehicles, 4)."""
        names = dict.fromkeys(name for shot in self._moments for name in shot.ids)
        rows = {name: row for row, name in enumerate(names)}
        found = np.full((len(self._moments), len(rows), 4), np.nan)
        for moment, shot in enumerate(self._moments):
            found[moment, [rows[name] for name in shot.ids]] = states_of(shot)
        return found


class Follower:
    """Compares an episode with a recording, decision by decision."""

    def __init__(self, recording: Recording) -> None:
        self._expected = recording.states
        self._compared = 0

    def add(self, decision: Transition) -> None:
        """Compare the scenes before and after the next decision with the recording.

        Raises RecordingError if any position or speed differs.
        """
        if self._compared == 0:
            self._compare(decision.scene)
        self._compare(decision.next_scene)

    def end(self) -> None:
        """Raise RecordingError if the recording has more decisions than the episode."""
        if self._compared < len(self._expected):
            raise self._left(self._compared - 1)

    def _compare(self, scene: Scene) -> None:
        expected = self._expected[self._compared : self._compared + 1]
        there = ~np.isnan(expected[:, :, 0]).all(axis=0)
        if not np.array_equal(states_of(scene.snapshot)[None], expected[:, there]):
            raise self._left(self._compared)
        self._compared += 1

    def _left(self, decision: int) -> RecordingError:
        return RecordingError(
            f"The replay differs from the recording at decision {decision}: it was made with "
            "another scenario, another version of SUMO or of drl-av, or on another platform."
        )


def states_of(snapshot: Snapshot) -> FloatArray:
    """Return s, y, speed and lateral speed of all vehicles, SI units, shape (1 + N, 4)."""
    return np.stack(
        (snapshot.s_m, snapshot.y_m, snapshot.speed_m_s, snapshot.lateral_speed_m_s), axis=1
    )
