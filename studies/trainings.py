"""Starts or continues the trainings of studies, and reads their results from their folders."""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from drl_av.config import Config, load_config
from drl_av.drivers import policy_file
from drl_av.errors import DrlAvError, RunError, pluralize
from drl_av.files.table import Row, read_table


@dataclass(frozen=True)
class TrainingJob:
    """A training of a study, up to the episode ``stop`` of its schedule."""

    variant: str
    config: Config
    stop: int
    """Last episode to drive; the config's schedule may be longer."""
    folder: Path
    every: int
    """Number of episodes from one row of the study's table to the next."""
    origin: "TrainingJob | None" = None
    """The training whose driver this training continues; None for a new driver."""

    @property
    def name(self) -> str:
        """Name of the training's folder, for example "paper-0": variant and seed."""
        return self.folder.name

    @property
    def key(self) -> Row:
        """The columns and values that all rows of the training have in common."""
        return {"variant": self.variant, "seed": str(self.config.learning.seed)}

    @property
    def policy(self) -> Path:
        """Path of the training's policy file, which the first checkpoint creates."""
        return self.folder / "policy.safetensors"

    @property
    def begun(self) -> bool:
        """Whether the folder of the training exists, so that it can continue."""
        return (self.folder / "config.toml").is_file()

    @property
    def last_row(self) -> int:
        """Episode of the training's last row in the table; 0 if it is too short for a row."""
        whole = self.stop == self.config.learning.episodes
        return self.stop if whole else self.stop // self.every * self.every

    @property
    def clock(self) -> Path:
        """Path of a CSV file beside the folder: episode, wall time since the previous row, s."""
        return self.folder.with_suffix(".seconds.csv")

    def require_same_settings(self) -> None:
        """Raise RunError if the training's folder, or that of its origin, has other settings."""
        if self.origin:
            self.origin.require_same_settings()
        if self.begun and load_config(self.folder / "config.toml") != self.config:
            raise RunError(
                f"{self.folder} was begun with other settings: choose another folder with --runs, "
                "or move it away."
            )

    def require_not_beyond(self) -> None:
        """Raise RunError if the training has continued beyond the last episode of this job."""
        file = self.folder / "checkpoint.safetensors"
        done = policy_file.load(file)[1]["episodes_done"] if file.is_file() else 0
        if done > self.stop:
            raise RunError(
                f"{self.folder} has continued to episode {done}, and its driver of episode "
                f"{self.stop} is lost: choose another folder with --runs."
            )

    def episodes_driven(self) -> int:
        """Return the number of episodes that the training has completed."""
        file = self.folder / "episodes.csv"
        return max(file.read_bytes().count(b"\n") - 1, 0) if file.is_file() else 0

    def wall_time_s(self) -> float | None:
        """Return the wall time of the training, s; None if it was not measured.

        An episode that was driven twice counts once. An incomplete last line in ``clock`` is
        ignored.
        """
        if not self.clock.is_file():
            return None
        text = self.clock.read_text(encoding="utf-8", errors="replace")
        lines = re.findall(r"^(\d+),(\d+\.\d)$", text, re.MULTILINE)
        return sum({episode: float(seconds) for episode, seconds in lines}.values())


class TrainingRows(NamedTuple):
    """The rows of a table that one training reports while it learns."""

    job: TrainingJob
    rows_of: Callable[[TrainingJob], list[Row]]
    """Reads the rows from the training's folder."""

    def keys(self, held: Sequence[Row]) -> list[Row]:
        """Return the columns that say the place of each row; ``held`` are the existing rows.

        Raises:
            ValueError: a row before the last one in ``held`` is missing.
            DrlAvError: the training has fewer episodes than one row summarizes.
        """
        job = self.job
        if job.last_row < 1:
            raise DrlAvError(
                f"A training of {pluralize(job.stop, 'episode')} makes no row of the table, which "
                f"sums up {job.every}: ask for as many at the least."
            )
        last = max((int(row["episode"]) for row in held), default=0)
        whole = [last] if last == job.config.learning.episodes else []
        if [int(row["episode"]) for row in held] != [
            *dict.fromkeys([*range(job.every, last + 1, job.every), *whole])
        ]:
            raise ValueError(f"{job.name} lacks a row before episode {last}")
        ends = dict.fromkeys([*range(job.every, job.last_row + 1, job.every), job.last_row])
        return [job.key | {"episode": str(end)} for end in ends]

    def reported(self) -> list[Row]:
        """Return the rows that the training has reported so far."""
        return self.rows_of(self.job)


def train_job(job: TrainingJob) -> None:
    """Start or continue a training up to the job's last episode; do nothing if it is complete.

    Raises:
        RunError: the folder holds a training with other settings, or another process uses it.
    """
    job.require_same_settings()
    from drl_av.learning.run_folder import open_training, train, warm_start

    prepare = partial(warm_start, policy_file=job.origin.policy) if job.origin else None
    opened = open_training(job.folder, job.config, resume=job.begun, prepare=prepare)
    with opened as (run, training):
        if training.episodes_done >= job.stop:
            return
        begun_s = time.monotonic()
        for _ in train(run, training):
            done = training.episodes_done
            stops = done >= job.stop
            if stops:
                run.save(training)
            if stops or done % job.config.learning.checkpoint_every == 0:
                now_s = time.monotonic()
                _append_time(job.clock, done, now_s - begun_s)
                begun_s = now_s
            if stops:
                return


def _append_time(clock: Path, episode: int, seconds: float) -> None:
    with clock.open("a", encoding="utf-8") as file:
        file.write(f"{episode},{seconds:.1f}\n")


def blocks_of(job: TrainingJob) -> list[Row]:
    """Return the rows of a training so far; each holds means over ``job.every`` episodes.

    The last row of a complete training may cover fewer episodes.
    """
    episodes = read_table(job.folder / "episodes.csv", growing=True)[: job.stop]
    ends = range(job.every, len(episodes) + 1, job.every)
    last = [job.stop] if len(episodes) == job.stop == job.config.learning.episodes else []
    return [
        {
            **job.key,
            "episode": str(end),
            **_while_exploring(episodes[(end - 1) // job.every * job.every : end]),
        }
        for end in dict.fromkeys([*ends, *last])
    ]


def evaluations_of(job: TrainingJob) -> list[Row]:
    """Return the rows of a training so far, one for each evaluation.

    A row has the results of the greedy driver in the evaluation, and the means of the training
    episodes since the previous evaluation, which include exploration.
    """
    evaluations = read_table(job.folder / "evaluations.csv", growing=True)
    episodes = read_table(job.folder / "episodes.csv", growing=True)  # written before those
    rows, before = [], 0
    for evaluation in evaluations:
        episode = int(evaluation["episode"])
        since = episodes[before:episode]
        if len(since) < episode - before:  # lost in a crash; they will be driven again
            break
        before = episode
        each = {"evaluation_episodes": str(job.config.learning.evaluation_episodes)}
        place = {**job.key, "episode": str(episode)}
        rows.append({**place, **evaluation, **each, **_while_exploring(since)})
    return rows


def _while_exploring(episodes: list[Row]) -> Row:
    count = len(episodes)
    reward = sum(float(row["mean_reward"]) for row in episodes) / count
    triggers = sum(int(row["safety_triggers"]) for row in episodes) / count
    return {
        "training_reward": f"{reward:.6g}",
        "training_collisions": f"{sum(row['collided'] == 'True' for row in episodes) / count:.6g}",
        "training_ego_hits": f"{sum(row['ego_hit'] == 'True' for row in episodes) / count:.6g}",
        "training_safety_triggers": f"{triggers:.6g}",
    }
