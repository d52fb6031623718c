"""Records an episode to a file, reads such a file, and compares a replay with it exactly."""

import hashlib
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote
from zipfile import is_zipfile

import numpy as np
import numpy.typing as npt

from drl_av.arrays import Float32Array, FloatArray, IntArray
from drl_av.config import Config, from_toml
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeResult
from drl_av.env.transition import Transition
from drl_av.errors import RecordingError, printable
from drl_av.evaluation import NEAR_MISS_DRAC_M_S2, NEAR_MISS_TTC_S
from drl_av.files.atomic import write_atomic
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.simulation.vehicle_calls import EgoModel

COLUMNS = ("s_m", "y_m", "speed_m_s", "lateral_speed_m_s")
"""The columns of ``Recording.states``, which the file holds as ``columns``."""
MAX_UNPACKED = 1_000_000_000
"""The largest size, bytes, of all arrays of a recording together."""


ARRAYS = ("proposed", "executed", "rules", "ids", "sizes_m", "time_s", "states")
"""The arrays of a recording, in the order of the fields of ``Recording``."""


@dataclass(frozen=True)
class Recording:
    """A recorded episode of T decisions: settings, seed, and all vehicles at each decision."""

    config: Config
    driver: str
    seed: int
    vehicles: int
    proposed: IntArray
    """Number of the proposed action of each decision, shape (T,)."""
    executed: IntArray
    """Number of the action after the safety check, shape (T,)."""
    rules: npt.NDArray[np.str_]
    """The rule by which the check changed the action, or ``none``, shape (T,)."""
    ids: npt.NDArray[np.str_]
    """The vehicles' ids in SUMO, shape (1 + N,), the ego first."""
    sizes_m: FloatArray
    """Length and width of each vehicle, shape (1 + N, 2)."""
    time_s: FloatArray
    """Time of each row of ``states`` since the reset, shape (T + 1,)."""
    states: FloatArray
    """Shape (T + 1, 1 + N, 4): the ``COLUMNS`` of each vehicle, SI units.

    On an open road, N counts each vehicle that was on the road at any decision. The states of a
    vehicle are NaN while it is not on the road.
    """
    ego_model: EgoModel | None = None
    """The parameters of SUMO's models, if they drove the ego; None if the driver's actions did."""

    @property
    def road(self) -> Road:
        """The road of the episode's scenario; raises ScenarioError if that cannot be read."""
        return load_scenario(find_scenario(self.config.simulation.scenario)).road

    def save(self, path: Path) -> None:
        """Write the recording to a .npz file atomically; raises DrlAvError if the write fails."""
        write_atomic(path, self.to_bytes())

    def to_bytes(self) -> bytes:
        """Return the bytes of the recording's .npz file."""
        parts: dict[str, Any] = {
            "config": np.array(self.config.to_toml()),
            "driver": np.array(self.driver),
            "seed": np.array(str(self.seed)),  # of any size
            "vehicles": np.array(self.vehicles),
            "columns": np.array(COLUMNS),
            **{name: getattr(self, name) for name in ARRAYS},
        }
        if self.ego_model is not None:
            parts["ego_model"] = np.array(self.ego_model, dtype=np.float64)
        data = io.BytesIO()
        np.savez_compressed(data, **parts, sha256=np.array(_checksum(parts)))
        return data.getvalue()


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
        parts = _parts(path)
        expected = str(parts.pop("sha256"))
        before = {"sizes_m": np.full((len(parts["ids"]), 2), np.nan)}  # of an older version
        arrays: dict[str, Any] = {name: (before | parts)[name] for name in ARRAYS}
        recording = Recording(
            config=from_toml(str(parts["config"]), name="its config"),
            driver=printable(str(parts["driver"])),
            seed=int(parts["seed"]),
            vehicles=int(parts["vehicles"]),
            ego_model=_ego_model(parts["ego_model"]) if "ego_model" in parts else None,
            **arrays,
        )
        _require_episode(recording)
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


def _parts(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Read the arrays of a .npz file by name; raise ValueError before one is too large."""
    with np.load(path, allow_pickle=False) as file:
        if sum(member.file_size for member in file.zip.infolist()) > MAX_UNPACKED:
            raise ValueError(f"it unpacks to more than {MAX_UNPACKED // 10**6} MB")
        parts = dict(file)
    if others := [name for name, part in parts.items() if not isinstance(part, np.ndarray)]:
        raise ValueError(f"its part {printable(others[0])} is no array")
    return parts


def _require_episode(recording: Recording) -> None:
    """Raise ValueError unless the arrays of a recording have the types and shapes of an episode."""
    states = recording.states
    if recording.seed < 0 or recording.vehicles < 0:
        raise ValueError("its seed or number of vehicles is negative")
    for actions in (recording.proposed, recording.executed):
        if actions.ndim != 1 or actions.dtype.kind not in "iu":
            raise ValueError("its actions are no row of whole numbers")
        if not ((actions >= 0) & (actions < len(ACTIONS))).all():
            raise ValueError(f"an action is not a number from 0 to {len(ACTIONS) - 1}")
    if states.ndim != 3 or states.shape[2] != 4 or states.dtype.kind != "f":
        raise ValueError("its states do not have the shape (decisions + 1, vehicles, 4)")
    decisions, vehicles = len(states) - 1, states.shape[1]
    if {len(recording.proposed), len(recording.executed)} != {decisions} or not vehicles:
        raise ValueError("its numbers of actions and of states differ")
    named = (recording.rules, (decisions,), "U"), (recording.ids, (vehicles,), "U")
    numbers = (recording.sizes_m, (vehicles, 2), "f"), (recording.time_s, (decisions + 1,), "f")
    for array, shape, kind in (*named, *numbers):
        if array.shape != shape or array.dtype.kind != kind:
            raise ValueError("its rules, ids, sizes or times do not fit its states")


class RecordedDriver:
    """A driver that proposes the actions of a recording in their order."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording

    def start(self, seed: int) -> None:
        """Start again with the first recorded action; ``seed`` is not used."""
        self._next: Iterator[int] = iter(self._recording.proposed.tolist())

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return the next recorded proposal; raises RecordingError after the last one."""
        try:
            return ACTIONS[next(self._next)]
        except (StopIteration, IndexError) as error:
            raise RecordingError(
                "The recording ends before the episode: it was made with another version."
            ) from error


def recording_of(
    decisions: Sequence[Transition], env: HighwayEnv, driver: str, seed: int
) -> Recording:
    """Return the recording of the episode that ``env`` has just driven.

    ``decisions`` are all of its decisions, at least one.
    """
    moments = [decisions[0].scene.snapshot, *(made.next_scene.snapshot for made in decisions)]
    names = dict.fromkeys(name for shot in moments for name in shot.ids)
    rows = {name: row for row, name in enumerate(names)}
    states = np.full((len(moments), len(rows), len(COLUMNS)), np.nan)
    sizes_m = np.zeros((len(rows), 2))
    for moment, shot in enumerate(moments):
        there = [rows[name] for name in shot.ids]
        states[moment, there] = states_of(shot)
        sizes_m[there] = np.stack((shot.length_m, shot.width_m), axis=1)
    return Recording(
        env.config.without_training,
        driver,
        seed,
        len(moments[0].ids) - 1,
        np.array([made.proposed.number for made in decisions], dtype=np.int64),
        np.array([made.executed.number for made in decisions], dtype=np.int64),
        np.array([str(made.rule) for made in decisions], dtype=np.str_),
        np.array([*names], dtype=np.str_),
        sizes_m,
        np.array([shot.time_s for shot in moments]),
        states,
        env.ego_model,
    )


class RecordingFolder(NamedTuple):
    """A folder that keeps the recordings of an evaluation, or only those of its failures."""

    folder: Path
    failures_only: bool

    def file(self, result: EpisodeResult) -> Path:
        """Return the path of an episode's recording, ``DRIVER-VEHICLES-SEED.npz``."""
        driver = quote(result.driver, safe="@")
        return self.folder / f"{driver}-{result.vehicles}-{result.seed}.npz"

    def keep(self, recording: Recording, result: EpisodeResult) -> None:
        """Save a recording, if it is wanted.

        Raises:
            RecordingError: the folder has a recording of another such episode.
            DrlAvError: the write fails.
        """
        if self.failures_only and not is_failure(result):
            return
        file, data = self.file(result), recording.to_bytes()
        if file.exists() and file.read_bytes() != data:
            raise RecordingError(
                f"{file} is the recording of another episode, for example with other settings: "
                "name another folder, or remove it."
            )
        write_atomic(file, data)


def is_failure(result: EpisodeResult) -> bool:
    """Return whether an episode has a collision or a near miss.

    A near miss has a time to collision of at most ``NEAR_MISS_TTC_S`` or, where it was measured, a
    DRAC of at least ``NEAR_MISS_DRAC_M_S2``.
    """
    drac_m_s2 = getattr(result, "max_drac_m_s2", 0.0)
    close = result.min_ttc_s <= NEAR_MISS_TTC_S or drac_m_s2 >= NEAR_MISS_DRAC_M_S2
    return result.collided or close


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
            "another scenario, other --sumo-options, another version of SUMO or of drl-av, or on "
            "another platform."
        )


def states_of(snapshot: Snapshot) -> FloatArray:
    """Return s, y, speed and lateral speed of all vehicles, SI units, shape (1 + N, 4)."""
    return np.stack(
        (snapshot.s_m, snapshot.y_m, snapshot.speed_m_s, snapshot.lateral_speed_m_s), axis=1
    )
