"""The folder of a run (settings, tables, checkpoint, policy): writes and reads it, trains in it."""

import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drl_av.config import Config, PpoConfig, from_toml, load_config
from drl_av.config.reference import annotated_toml
from drl_av.drivers.policy_file import load, load_policy, save, save_policy
from drl_av.drivers.registry import DRIVER_FILES
from drl_av.env.custom import NOTHING_CUSTOM, CustomParts, custom_inputs
from drl_av.env.highway import HighwayEnv
from drl_av.errors import CheckpointError, ConfigError, DrlAvError, RunError
from drl_av.files.atomic import locked, refusals, replacing
from drl_av.files.table import table_bytes
from drl_av.learning.algorithm_1 import EpisodeRow, EvaluationRow, Training, build_training

OPEN = {"scenario", "sumo_options"}
"""The parts of a run without an episode that may still be corrected."""
AT_SCALE = "updates.csv"
"""The table of a training at scale, which no run of Algorithm 1 has."""


class Progress(NamedTuple):
    """The table rows that one training episode has added."""

    episode: EpisodeRow
    evaluation: EvaluationRow | None
    """The evaluation after this episode, or None if none is due."""


class Run:
    """The folder of a run: config.toml, two CSV files, and checkpoint and policy as safetensors.

    Every byte in it depends only on the config, the user's own parts and the initial state of the
    training, even if the training was interrupted and continued.
    """

    def __init__(self, folder: Path, custom: CustomParts = NOTHING_CUSTOM) -> None:
        self.folder, self._custom = folder, custom
        self._parts = dict[str, str]()
        self.config_file = folder / "config.toml"
        self.episodes_file = folder / "episodes.csv"
        self.evaluations_file = folder / "evaluations.csv"
        self.checkpoint_file = folder / "checkpoint.safetensors"
        self.policy_file = folder / "policy.safetensors"

    def create(self, training: Training) -> None:
        """Create the folder atomically, with a checkpoint of ``training``, which has not begun.

        Raises:
            RunError: the folder exists and is not empty, or cannot be created.
            CheckpointError: the checkpoint cannot be written.
        """
        self._parts = custom_inputs(training.config, self._custom)
        require_new(self.folder, resumable=True)
        with made_folder(self.folder, training.config) as folder:
            new = Run(folder, self._custom)
            new._parts = self._parts
            new.episodes_file.write_bytes(table_bytes(EpisodeRow))
            new.evaluations_file.write_bytes(table_bytes(EvaluationRow))
            new._save_checkpoint(training)

    def read_config(self) -> Config:
        """Read the settings of the run; raises RunError if the folder has no config.toml.

        ``restore`` finds a file that is cut short: its settings are not those of the checkpoint.
        """
        if not self.config_file.is_file():
            raise RunError(f"{self.folder} is not a run: it has no config.toml; check the path.")
        return load_config(self.config_file)

    def restore(self, training: Training) -> None:
        """Restore a new training from the checkpoint.

        Rows of the tables that were written after the checkpoint are removed; the training writes
        them again.

        Raises:
            CheckpointError: the checkpoint is missing, damaged or of another config, or rows are
                missing.
            RunError: a table cannot be written, or the training began with other parts of the
                user's.
        """
        if not self.checkpoint_file.exists():
            raise CheckpointError(
                f"{self.folder} has no {self.checkpoint_file.name}, from which the training would "
                "continue: put the file back, or begin a new run."
            )
        tensors, numbers = load(self.checkpoint_file)
        settings = str(numbers.get("config"))
        if numbers.get("kind") != "training" or not _fits(settings, training.config):
            raise CheckpointError(
                f"{self.checkpoint_file} belongs to other settings than {self.config_file}: "
                "put back the config.toml of that training, or begin a new run."
            )
        tables = self.episodes_file.name, self.evaluations_file.name
        try:
            training.restore(tensors, numbers)
            sizes = {name: int(numbers["sizes"][name]) for name in tables}
            begun = {str(name): str(part) for name, part in numbers["custom"].items()}
            if not 0 <= training.episodes_done <= training.config.learning.episodes:
                raise ValueError("it counts more episodes than the training has")
            if min(sizes.values()) < 0:
                raise ValueError("a table has a negative size")
        except (LookupError, TypeError, ArithmeticError, ValueError, AttributeError) as error:
            raise CheckpointError(
                f"{self.checkpoint_file} holds no training of this version ({error!r}): "
                "take an older copy, or begin a new run."
            ) from error
        self._parts = custom_inputs(training.config, self._custom)
        for name, now in self._parts.items():
            was, option = begun.get(name, ""), "--" + name.replace("_", "-")
            if was != now and (training.episodes_done or name not in OPEN):
                how = f"with {option} {_without_digest(was)}" if was else f"without {option}"
                if name == "scenario":
                    how = f"with other files of the scenario {training.config.simulation.scenario}"
                raise RunError(
                    f"{self.folder} was begun {how}: give all parts, and their files, as they were "
                    "then, or begin a new run."
                )
        for name, row in zip(tables, (EpisodeRow, EvaluationRow), strict=True):
            file, size = self.folder / name, sizes[name]
            held = file.read_bytes()[:size] if file.is_file() else b""
            is_whole = held.startswith(table_bytes(row)) and held.endswith(b"\n")
            counts = [line.partition(b",")[0] for line in held.splitlines()[1:]]
            counted = [b"%d" % (n + 1) for n in range(training.episodes_done)]
            if len(held) < size or not is_whole or (row is EpisodeRow and counts != counted):
                raise CheckpointError(
                    f"{file} has lost rows that {self.checkpoint_file.name} counts, or has others: "
                    "put the file back, or begin a new run."
                )
        for name, size in sizes.items():
            file = self.folder / name
            if file.stat().st_size > size:
                with _refusals_of(file):
                    os.truncate(file, size)

    def save(self, training: Training) -> None:
        """Write the policy and the checkpoint, each file atomically.

        Raises:
            RunError: a table cannot be written.
            CheckpointError: the policy or the checkpoint cannot be written.
        """
        save_policy(self.policy_file, training.network, training.config)
        self._save_checkpoint(training)

    def _save_checkpoint(self, training: Training) -> None:
        sizes = {}
        for file in (self.episodes_file, self.evaluations_file):
            with _refusals_of(file), file.open("ab") as stream:
                os.fsync(stream.fileno())
                sizes[file.name] = stream.tell()
        tensors, numbers = training.state()
        numbers |= {"kind": "training", "config": training.config.to_toml(), "sizes": sizes}
        numbers["custom"] = self._parts
        save(self.checkpoint_file, tensors, numbers)

    def append(self, file: Path, row: EpisodeRow | EvaluationRow) -> None:
        """Add a row to one of the CSV files; raises RunError if it cannot be written."""
        with _refusals_of(file), file.open("ab") as stream:
            stream.write(table_bytes(type(row), [row], header=False))


def require_new(folder: Path, resumable: bool = False) -> None:
    """Raise RunError if a run's folder has files already, or looks like the file of a driver.

    ``resumable`` says whether the new run would be one that can be resumed.
    """
    if folder.suffix.lower() in DRIVER_FILES:
        raise RunError(
            f"{folder} names a file, but a run's folder cannot end in {folder.suffix}: choose "
            "another name."
        )
    if folder.exists() and not folder.is_dir():
        raise RunError(f"{folder} is a file: choose a folder with --out.")
    if folder.exists() and any(folder.iterdir()):
        continues = resumable and not (folder / AT_SCALE).exists()
        remedy = "continue it with --resume, or " if continues else ""
        raise RunError(f"{folder} exists already: {remedy}choose another folder with --out.")


@contextmanager
def made_folder(folder: Path, config: Config) -> Iterator[Path]:
    """Make a run's folder with its ``config.toml`` atomically; the block adds files in it.

    Raises RunError if the folder cannot be made.
    """
    what, remedy = f"The run folder {folder} cannot be made", "choose another folder with --out"
    with refusals(what, remedy, RunError):
        folder.parent.mkdir(parents=True, exist_ok=True)
    with replacing(folder, RunError) as new:
        new.mkdir()
        (new / "config.toml").write_text(annotated_toml(config), encoding="utf-8")
        yield new


def _without_digest(part: str) -> str:
    """Return the word of one of the user's own parts, as the command line has it."""
    return re.sub(" [0-9a-f]{64}$", "", part)


def _fits(stored: str, config: Config) -> bool:
    """Return whether TOML settings equal ``config``."""
    try:
        return from_toml(stored) == config
    except ConfigError:
        return False


def _refusals_of(file: Path) -> AbstractContextManager[None]:
    """Replace an OSError in the block by a RunError that says how to continue."""
    return refusals(
        f"{file} cannot be written",
        "free some space or make it writable, then continue with --resume; nothing saved before is "
        "lost",
        RunError,
    )


def require_no_hold(config: Config) -> None:
    """Raise ConfigError if the settings hold speeds and lane changes, which no training does."""
    if config.driver.hold_s:
        raise ConfigError(
            f"driver.hold_s is {config.driver.hold_s:g}, but a training would ignore it: leave it "
            "out, and give it to evaluate or replay."
        )


@contextmanager
def open_training(
    folder: Path,
    config: Config,
    custom: CustomParts = NOTHING_CUSTOM,
    *,
    resume: bool = False,
    prepare: Callable[[Training], object] | None = None,
) -> Iterator[tuple[Run, Training]]:
    """Begin a training in a new folder, or ``resume`` the one there; lock the folder in the block.

    ``prepare`` changes a new training before its folder is made, as ``warm_start`` does.

    Raises:
        ConfigError, ScenarioError: the settings do not fit each other, the road or the memory.
        RunError: the folder is not new, cannot be made, or another process trains in it.
        CheckpointError: the checkpoint is damaged or of other settings, or cannot be written.
    """
    if not resume:
        require_no_hold(config)
        if config.learning.algorithm == "ppo":
            raise ConfigError(
                "learning.algorithm is ppo, but this training is by Algorithm 1: leave it out."
            )
        require_new(folder, resumable=True)
    run, usual = Run(folder, custom), asdict(PpoConfig())
    if others := [name for name, value in asdict(config.ppo).items() if value != usual[name]]:
        raise ConfigError(
            f"ppo.{others[0]} belongs to PPO at scale, and Algorithm 1 would ignore it: leave it "
            "out, or choose the preset large."
        )
    with closing(HighwayEnv(config=config, **custom._asdict())) as env:
        training = build_training(env)
        if not resume:
            if prepare:
                prepare(training)
            run.create(training)
            if prepare:
                run.save(training)
        with locked(folder):
            run.restore(training)
            yield run, training


def train(run: Run, training: Training) -> Iterator[Progress]:
    """Train to the last episode, with evaluations and checkpoints; yield the rows of each episode.

    The rows are in the CSV files before they are yielded. Raises RunError or CheckpointError if a
    file cannot be written, and DrlAvError if the training diverges; its last checkpoint stays.
    """
    config = training.config.learning
    while training.episodes_done < config.episodes:
        row, evaluation = training.run_episode(), None
        if not np.isfinite(training.network.flat).all():
            raise DrlAvError(
                f"The training diverged in episode {training.episodes_done}: its weights are no "
                "finite numbers any more. The last checkpoint stays; begin a new run with a "
                "smaller learning.learning_rate, or with smaller rewards."
            )
        run.append(run.episodes_file, row)
        last = training.episodes_done == config.episodes
        if training.episodes_done % config.evaluate_every == 0 or last:
            evaluation = training.evaluate()
            run.append(run.evaluations_file, evaluation)
        if training.episodes_done % config.checkpoint_every == 0 or last:
            run.save(training)
        yield Progress(row, evaluation)
    try:
        load_policy(run.policy_file)
    except CheckpointError:  # it is missing or damaged
        run.save(training)


def warm_start(training: Training, policy_file: Path, reward: str = "") -> bool:
    """Load a trained driver into a new training, in place; return whether experience was loaded.

    If the policy file is the ``policy.safetensors`` of a run with a checkpoint, the training gets
    the checkpoint's network, target network, Adam moments and experience (returns True).
    Otherwise the online and the target network are copies of the policy's network, and the
    buffers stay empty (returns False). ``reward`` is the user's own reward, as ``custom_inputs``
    has it.

    Raises:
        RunError: the experience has other rewards, or another gap condition (eq. 3) or discount.
        CheckpointError: a file is damaged, or does not fit the settings of this training.
    """
    tensors, numbers = training.state()
    checkpoint_file = policy_file.with_name("checkpoint.safetensors")
    experienced = policy_file.name == "policy.safetensors" and checkpoint_file.is_file()
    if experienced:
        tensors, found = load(checkpoint_file)
        if found.get("kind") != "training":
            raise CheckpointError(f"{checkpoint_file} is not a training's: put back the run's own.")
        _require_its_rewards(policy_file.parent, found, training.config, reward)
    else:
        network, _ = load_policy(policy_file)
        tensors |= {"learner.online": network.flat, "learner.target": network.flat}
    training.restore(tensors, numbers)
    return experienced


def _require_its_rewards(run: Path, found: Mapping[str, Any], config: Config, reward: str) -> None:
    """Raise RunError unless the experience of a checkpoint has the rewards of this training."""
    was, before = str(dict(found.get("custom", {})).get("reward", "")), from_toml(found["config"])
    then, now = (
        (c.reward, c.learning.discount, c.safety.minimum_gap_m, c.safety.minimum_ttc_s)
        for c in (before, config)
    )
    if (was, then) != (reward, now):
        how = f"with --reward {_without_digest(was)}" if was else "without --reward"
        raise RunError(
            f"{run} was trained {how} and with the [reward], learning.discount and gap condition "
            "(safety.minimum_gap_m, minimum_ttc_s) of its config.toml, which its experience has: "
            "give all, and their files, as they were then, or move its checkpoint.safetensors away "
            "to adapt without that experience."
        )
