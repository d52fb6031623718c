"""Trains a driver from a user's program, ``drl_av.train``, and writes its rows for TensorBoard."""

import importlib
import random
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from drl_av.config import Config
from drl_av.config.presets import as_config
from drl_av.env.custom import NOTHING_CUSTOM, CustomParts, with_check
from drl_av.env.transition import RewardFunction
from drl_av.errors import ConfigError, RunError, needed_by
from drl_av.files.atomic import refusals
from drl_av.learning.run_folder import Progress, open_training
from drl_av.learning.run_folder import train as train_run
from drl_av.safety.check import SafetyCheck
from drl_av.scenarios.folder import with_scenario


def train(
    out: str | Path,
    *,
    config: Config | Mapping[str, Any] | str | Path | None = None,
    episodes: int | None = None,
    seed: int | None = None,
    scenario: str | Path | None = None,
    safety_check: str | SafetyCheck | None = None,
    traffic: str | None = None,
    reward: str | RewardFunction | None = None,
) -> Path:
    """Train a driver as ``drl-av train`` does: by Algorithm 1 of the paper, or by PPO at scale.

    From then on torch, and numpy after Algorithm 1, compute in one thread of this process.

    Args:
        out: The run's folder, which must be new.
        config: Settings: a preset such as "large", a TOML file, a dictionary or a Config.
        episodes: Number of episodes of Algorithm 1; by default that of the settings.
        seed: Random seed; by default that of the settings.
        scenario: Folder of a scenario, or the name of a shipped one.
        safety_check: The name of a check, or your own: a function, or its name as
            ``"module:function"``.
        traffic: The name of a kind of traffic, whose settings ``config`` may change.
        reward: Your own reward, a function or its name as ``"module:function"``.

    Returns:
        The run's folder, which ``evaluate`` and ``load_driver`` accept as a driver.

    Raises:
        ConfigError, ScenarioError: an argument is wrong.
        RunError, CheckpointError: the folder is not new, or cannot be written.
        SimulationError: SUMO ended unexpectedly; ``drl-av train --resume`` continues.
    """
    settings = with_scenario(as_config(config, traffic=traffic), scenario, traffic)
    settings, own_check = with_check(settings, safety_check)
    given = {"episodes": episodes, "seed": seed}
    given = {name: value for name, value in given.items() if value is not None}
    settings = settings.updated("learning", **given)
    if settings.learning.algorithm == "ppo" and (own_check or reward or episodes is not None):
        raise ConfigError(
            "safety_check as a function, reward and episodes belong to the training by Algorithm "
            "1, but this one is PPO at scale: leave them out, or choose another preset."
        )
    train_to_end(Path(out), settings, CustomParts(own_check, reward))
    return Path(out)


@contextmanager
def _random_numbers_kept() -> Iterator[None]:
    """Let the program's random numbers go on after the block, in which PPO seeds them anew."""
    import torch

    python, numpy = random.getstate(), np.random.get_state()
    on_gpus = torch.cuda.is_initialized()  # type: ignore[no-untyped-call]
    gpus = range(torch.cuda.device_count() if on_gpus else 0)
    try:
        with torch.random.fork_rng(gpus):
            yield
    finally:
        random.setstate(python)
        np.random.set_state(numpy)


def train_to_end(
    folder: Path,
    config: Config,
    custom: CustomParts = NOTHING_CUSTOM,
    *,
    resume: bool = False,
    tensorboard: bool = False,
) -> None:
    """Train in a new folder, or ``resume`` the training there by Algorithm 1; show no progress.

    Raises:
        As ``open_training`` and ``train_at_scale``.
    """
    if config.learning.algorithm == "ppo":
        from drl_av.learning.large_scale import train_at_scale  # it needs sb3-contrib

        with _random_numbers_kept():
            for _ in train_at_scale(folder, config):
                pass
        return
    with open_training(folder, config, custom, resume=resume) as (run, training):
        events = run.folder / "tensorboard" if tensorboard else None
        with tensorboard_writer(events, training.episodes_done) as write:
            for progress in train_run(run, training):
                write(progress)


def require_tensorboard() -> None:
    """Raise DrlAvError if the package tensorboard is not installed."""
    with needed_by("--tensorboard", "tensorboard", "'drl-av[tensorboard]'"):
        importlib.import_module("tensorboard")


@contextmanager
def tensorboard_writer(
    folder: Path | None, episodes_done: int
) -> Iterator[Callable[[Progress], None]]:
    """Yield a function that writes the table rows of an episode as TensorBoard scalars.

    The scalars are ``episode/COLUMN`` and ``evaluation/COLUMN``. If ``folder`` is None, the
    function does nothing. If an interrupted training has already written scalars of episodes after
    ``episodes_done``, TensorBoard discards them. Raises RunError if the folder cannot be written.
    """
    if folder is None:
        yield lambda progress: None
        return
    from torch.utils.tensorboard import SummaryWriter

    hook = threading.excepthook

    def report(problem: threading.ExceptHookArgs) -> None:
        if not isinstance(problem.exc_value, OSError):  # add_scalar raises it again
            hook(problem)

    def write(progress: Progress) -> None:
        for group, row in (("episode", progress.episode), ("evaluation", progress.evaluation)):
            for name, value in asdict(row).items() if row else ():
                with _refusals_of(folder):
                    writer.add_scalar(f"{group}/{name}", value, progress.episode.episode)

    threading.excepthook = report
    try:
        with _refusals_of(folder):
            writer = SummaryWriter(str(folder), purge_step=episodes_done + 1)
        try:
            yield write
        finally:
            with _refusals_of(folder):
                writer.close()
    finally:
        threading.excepthook = hook


def _refusals_of(folder: Path) -> AbstractContextManager[None]:
    return refusals(
        f"The TensorBoard events in {folder} cannot be written",
        "free some space, or continue with --resume and without --tensorboard",
        RunError,
    )
