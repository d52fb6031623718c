"""Trains one driver for each of several random seeds: ``drl-av train --seeds 1-5 --jobs 2``."""

import argparse
import glob
import re
import shlex
import shutil
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from drl_av.cli.console import INTERRUPTED
from drl_av.config import Config
from drl_av.errors import SimulationError, pluralize
from drl_av.evaluation import LOKY

if TYPE_CHECKING:
    from drl_av.env.custom import CustomParts

MOST_SEEDS = 1000


def seed_list(text: str) -> list[int]:
    """Convert words such as ``1-5`` or ``1,3,7-9`` to the list of their seeds."""
    seeds = list[int]()
    for part in text.split(","):
        if not (found := re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", part)):
            raise argparse.ArgumentTypeError(f"{text!r} does not have the form 1-5 or 1,3,7")
        first = int(found[1])
        last = int(found[2] or first)
        if not 0 <= last - first < MOST_SEEDS:
            raise argparse.ArgumentTypeError(f"{part} is not 1 to {MOST_SEEDS} seeds")
        seeds += range(first, last + 1)
    return list(dict.fromkeys(seeds))


class SeedJob(NamedTuple):
    """The training of one seed, in a run's folder of its own."""

    folder: Path
    config: Config
    custom: "CustomParts"
    tensorboard: bool

    @property
    def is_at_scale(self) -> bool:
        """Whether it is PPO at scale, not Algorithm 1."""
        return self.config.learning.algorithm == "ppo"

    @property
    def total(self) -> int:
        """Number of rows in the table of the complete training."""
        if self.is_at_scale:
            return self.config.ppo.decisions // self.config.ppo.batch_size
        return self.config.learning.episodes

    @property
    def done(self) -> int:
        """Number of rows, of an episode or an update, that the training has written."""
        table = self.folder / ("updates.csv" if self.is_at_scale else "episodes.csv")
        return max(table.read_bytes().count(b"\n") - 1, 0) if table.is_file() else 0

    @property
    def is_stopped(self) -> bool:
        """Whether it is a training at scale that was stopped: only Algorithm 1 can continue."""
        return (
            self.is_at_scale and (self.folder / "config.toml").exists() and self.done < self.total
        )


def train_seed(job: SeedJob) -> None:
    """Start or continue one training, up to its end; do nothing if it is complete.

    A training at scale whose process was killed, which an engine starts again, begins anew.

    Raises:
        RunError: the folder is not new and not a run, or another process trains in it.
    """
    from drl_av.files.atomic import locked
    from drl_av.learning.train import train_to_end

    if job.is_stopped:
        with locked(job.folder):
            shutil.rmtree(job.folder)
    begun = (job.folder / "config.toml").exists()
    if not (begun and job.is_at_scale):
        train_to_end(job.folder, job.config, job.custom, resume=begun, tensorboard=job.tensorboard)


def train_seeds(
    jobs: Sequence[SeedJob], processes: int, command: str, checks: Sequence[str]
) -> int:
    """Train all jobs in so many processes, with a progress bar; return the exit status.

    Each run has the same bytes as one that ``drl-av train --seed`` makes alone. ``command`` is the
    command line without ``--resume``; with it, where a run has begun, it continues after a stop.
    ``checks`` are the options with which ``evaluate`` has their safety check.
    """
    from drl_av.cli.console import progress_bar
    from drl_av.evaluation.engines import ENGINES
    from drl_av.simulation.sumo_options import require_one_process

    if processes > 1:
        require_one_process(jobs[0].custom.sumo_options)
    try:
        with (
            progress_bar("training", sum(job.total for job in jobs)) as bar,
            closing(ENGINES[LOKY](train_seed, jobs, processes)) as running,
        ):
            ended = 0
            for finished in running:
                ended += len(finished)
                done = sum(job.done for job in jobs)
                text = f"{ended} of {pluralize(len(jobs), 'training')} complete"
                bar.reach(done, sum(job.total for job in jobs), text)
    except KeyboardInterrupt:
        print(f"drl-av: stopped; {way_on(jobs, command)}", file=sys.stderr)
        return INTERRUPTED
    except SimulationError as error:
        reason = str(error).removesuffix(".")
        raise SimulationError(f"{reason}; {way_on(jobs, command)}.") from error
    folder = jobs[0].folder.parent
    print(f"{folder}: {pluralize(len(jobs), 'training')}; compare them with a rule-based driver:")
    print(shlex.join(["drl-av", "evaluate", group_of(folder), "gap-mobil", *checks]))
    return 0


def group_of(folder: Path) -> str:
    """Return the word by which ``evaluate`` finds the trainings in a folder, ``NAME=PATTERN``."""
    from drl_av.drivers.registry import driver_names

    name = re.sub(r"[^\w.-]|^-", "_", folder.absolute().name)
    if name in driver_names():
        name += "-seeds"
    return f"{name}={Path(glob.escape(str(folder))) / 'seed-*'}"


def way_on(jobs: Sequence[SeedJob], command: str) -> str:
    """Return what continues the jobs: the folders to move away, if any, and the command."""
    away = "".join(f"move {job.folder} away, and " for job in jobs if job.is_stopped)
    goes_on = any((job.folder / "config.toml").exists() and not job.is_stopped for job in jobs)
    return f"{away}continue with: {command}{' --resume' if goes_on else ''}"
