"""The trainings behind the learning curves, driven a leg at a time, each in its own process."""

import csv
import re
import time
from contextlib import ExitStack, closing
from pathlib import Path
from typing import NamedTuple

from drl_av.config import BEFORE, Config, load_config
from drl_av.errors import RunError
from drl_av.files import Row


class Leg(NamedTuple):
    """A training to be driven up to an episode of its schedule."""

    variant: str
    seed: int
    stop: int
    """Last episode to drive; the config's schedule may go on beyond it."""
    config: Config
    folder: Path
    every: int
    """Episodes that a row of its table sums up."""
    origin: "Leg | None" = None
    """The training whose driver goes on learning here; None for one that begins anew."""

    @property
    def policy(self) -> Path:
        """The driver of the training, as soon as it has saved one."""
        return self.folder / "policy.safetensors"

    @property
    def begun(self) -> bool:
        """Whether there is a folder to go on from."""
        return (self.folder / "config.toml").is_file()

    @property
    def last_row(self) -> int:
        """Episode of the last row that it brings to its table."""
        whole = self.stop == self.config.learning.episodes
        return self.stop if whole else self.stop // self.every * self.every

    @property
    def clock(self) -> Path:
        """CSV file beside the folder: the wall time of the episodes up to each checkpoint."""
        return self.folder.with_suffix(".seconds.csv")


def require_same_settings(leg: Leg) -> None:
    """Raise RunError where the leg's folder, or its origin's, was begun with other settings."""
    if leg.origin:
        require_same_settings(leg.origin)
    if leg.begun and load_config(leg.folder / "config.toml", BEFORE) != leg.config:
        raise RunError(
            f"{leg.folder} was begun with other settings: choose another folder with --runs, "
            "or move it away."
        )


def drive_leg(leg: Leg) -> None:
    """Train up to the leg's last episode, from the last checkpoint on; nothing where it is done.

    Raises:
        RunError: the folder holds a training with other settings, or another process is in it.
    """
    require_same_settings(leg)
    from drl_av.env.highway import HighwayEnv
    from drl_av.learning.adaptation import take_over
    from drl_av.learning.run import Run, train
    from drl_av.learning.training import Training

    run = Run(leg.folder)
    with closing(HighwayEnv(config=leg.config)) as env, ExitStack() as stack:
        training = Training(env)
        if not leg.begun:
            if leg.origin:
                take_over(training, leg.origin.policy)
            run.create(leg.config, training if leg.origin else None)
        stack.enter_context(run.alone())
        run.restore(training)
        if training.episodes_done >= leg.stop:
            return
        begun_s = time.monotonic()
        for _ in train(run, training):
            done = training.episodes_done
            stops = done >= leg.stop
            if stops:
                run.save(training)
            if stops or done % leg.config.learning.checkpoint_every == 0:
                now_s = time.monotonic()
                _note(leg.clock, done, now_s - begun_s)
                begun_s = now_s
            if stops:
                return


def _note(clock: Path, episode: int, seconds: float) -> None:
    with clock.open("a", encoding="utf-8") as file:
        file.write(f"{episode},{seconds:.1f}\n")


def wall_time_s(clock: Path) -> float | None:
    """Seconds that the training took, each episode counted once; None where nobody measured.

    A line that was cut short when the process ended does not count.
    """
    if not clock.is_file():
        return None
    lines = re.findall(
        r"^(\d+),(\d+\.\d)$", clock.read_text(encoding="utf-8", errors="replace"), re.M
    )
    return sum({episode: float(seconds) for episode, seconds in lines}.values())


def episodes_driven(folder: Path) -> int:
    """Rows of the training's ``episodes.csv`` so far."""
    file = folder / "episodes.csv"
    return max(file.read_bytes().count(b"\n") - 1, 0) if file.is_file() else 0


def blocks_of(leg: Leg) -> list[Row]:
    """What the training has brought so far, a row for so many episodes."""
    episodes = _whole_rows(leg.folder / "episodes.csv")[: leg.stop]
    ends = range(leg.every, len(episodes) + 1, leg.every)
    last = [leg.stop] if len(episodes) == leg.stop == leg.config.learning.episodes else []
    return [
        {**_place(leg, end), **_training(episodes[(end - 1) // leg.every * leg.every : end])}
        for end in dict.fromkeys([*ends, *last])
    ]


def _place(leg: Leg, episode: int) -> Row:
    return {"variant": leg.variant, "seed": str(leg.seed), "episode": str(episode)}


def evaluations_of(leg: Leg) -> list[Row]:
    """What the training has brought so far, a row an evaluation.

    Beside the greedy driver's means stand those of the training episodes since the evaluation
    before, which explored.
    """
    evaluations = _whole_rows(leg.folder / "evaluations.csv")
    episodes = _whole_rows(leg.folder / "episodes.csv")  # written before their evaluation
    rows, before = [], 0
    for evaluation in evaluations:
        episode = int(evaluation["episode"])
        since = episodes[before:episode]
        if len(since) < episode - before:  # lost with the power; they will be driven again
            break
        before = episode
        each = {"evaluation_episodes": str(leg.config.learning.evaluation_episodes)}
        rows.append({**_place(leg, episode), **evaluation, **each, **_training(since)})
    return rows


def _training(episodes: list[Row]) -> Row:
    count = len(episodes)
    reward = sum(float(row["mean_reward"]) for row in episodes) / count
    triggers = sum(int(row["safety_triggers"]) for row in episodes) / count
    return {
        "training_reward": f"{reward:.6g}",
        "training_collisions": f"{sum(row['collided'] == 'True' for row in episodes) / count:.6g}",
        "training_ego_hits": f"{sum(row['ego_hit'] == 'True' for row in episodes) / count:.6g}",
        "training_safety_triggers": f"{triggers:.6g}",
    }


def _whole_rows(file: Path) -> list[Row]:
    """The rows of a file that somebody may be writing to: not the one that is on its way."""
    if not file.is_file():
        return []
    whole = file.read_text(encoding="utf-8").rpartition("\n")[0]
    return list(csv.DictReader(whole.splitlines()))
