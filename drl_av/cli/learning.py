"""The verbs ``train`` (learning from scratch) and ``adapt`` (continual adaptation)."""

import argparse
import shlex
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_av.cli.console import INTERRUPTED
from drl_av.cli.options import (
    add_env_options,
    add_flag,
    add_number,
    add_path,
    add_text,
    custom_parts,
    require_one_word,
    with_command_line,
)
from drl_av.cli.seeds import SeedJob, seed_list, train_seeds
from drl_av.config import REPLAYS, Config
from drl_av.config.presets import PRESETS, adaptation, preset
from drl_av.errors import ConfigError, RunError, SimulationError, pluralize

if TYPE_CHECKING:
    from drl_av.drivers.registry import DriverSpec
    from drl_av.learning.algorithm_1 import Training
    from drl_av.learning.run_folder import Run


def add_train_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av train`` to its parser."""
    add_path(parser, "--out", "RUN", "the run's folder; must be new", needed=True)
    add_text(parser, "--preset", "NAME", f"one of: {', '.join(PRESETS)} (default: paper)")
    usual = Config().learning.episodes
    episodes = f"episodes of at most 200 s of Algorithm 1 (default: the preset's, {usual})"
    add_number(parser, "--episodes", 1, episodes)
    seeds = parser.add_mutually_exclusive_group()
    add_number(seeds, "--seed", 0, "random seed (default: the preset's)", shown="S")
    seeds.add_argument(
        "--seeds",
        type=seed_list,
        metavar="S",
        help="several seeds, such as 1-5 or 1,3,7: a run for each, RUN/seed-1 and so on",
    )
    add_number(parser, "--jobs", 1, "number of processes that share the runs of --seeds", 1)
    replay = f"one of: {', '.join(REPLAYS)} (default: the preset's)"
    add_text(parser, "--replay", "KIND", replay)
    add_env_options(parser, "the preset's", zips=False)
    add_flag(parser, "--resume", "continue a run of Algorithm 1 that was stopped")
    add_flag(parser, "--tensorboard", "Algorithm 1: also write TensorBoard events into the folder")


def add_adapt_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av adapt`` to its parser."""
    parser.add_argument(
        "run",
        nargs="?",
        metavar="RUN",
        help="folder of the run to start from (default: pretrained-paper)",
    )
    add_path(parser, "--out", "RUN2", "the new run's folder; must be new", needed=True)
    add_number(parser, "--episodes", 1, "episodes of at most 200 s (default: 30000)")
    parser.add_argument(
        "--learning-rate",
        type=float,
        metavar="X",
        help="step size of Adam; 0 drives without learning (default: 1e-05)",
    )
    add_number(parser, "--seed", 0, "random seed (default: the RUN's, plus 1)", shown="S")
    add_env_options(parser, "the RUN's", zips=False)
    add_flag(parser, "--resume", "continue RUN2 where it was stopped, without RUN")
    add_flag(parser, "--tensorboard", "also write TensorBoard events into RUN2")


def train(options: argparse.Namespace) -> int:
    """Train a driver by Algorithm 1 in the run folder ``--out``; return the exit status."""
    from drl_av.learning.run_folder import Run, open_training
    from drl_av.learning.train import require_tensorboard

    if options.tensorboard:
        require_tensorboard()
    if options.seeds:
        jobs = _seed_jobs(options)
        command = ["drl-av", *(word for word in options.words if word != "--resume")]
        return train_seeds(jobs, options.jobs, shlex.join(command), _checks(options))
    if options.jobs > 1:
        raise ConfigError(f"--jobs {options.jobs} needs --seeds: one training uses one process.")
    run = Run(options.out)
    stored = _stored(run) if options.resume else None
    config = _asked(options, stored)
    if stored is not None:
        _require_unchanged(run, stored, config)
    if config.learning.algorithm == "ppo":
        return _train_at_scale(options, config)
    custom = custom_parts(options)
    with open_training(options.out, config, custom, resume=options.resume) as opened:
        return _run("train", *opened, options, "idm")


def _train_at_scale(options: argparse.Namespace, config: Config) -> int:
    """Train a driver by PPO in the twin; return the exit status.

    Raises:
        ConfigError: an option is given that only Algorithm 1 has.
    """
    from drl_av.cli.console import progress_bar, stop_request
    from drl_av.learning.large_scale import train_at_scale

    _require_options_of_ppo(options)
    done, updates = 0, config.ppo.decisions // config.ppo.batch_size
    with (
        stop_request("update") as stop,
        progress_bar("training, updates", updates) as bar,
        closing(train_at_scale(options.out, config)) as training,
    ):
        for progress in training:
            bar.advance(
                f"reward {progress.mean_reward:.3f}, collisions {progress.collisions}",
                progress.decisions - done,
            )
            done = progress.decisions
            if stop.made and done < updates * config.ppo.batch_size:
                print("drl-av: stopped; what was learned so far is in the folder.", file=sys.stderr)
                return INTERRUPTED
    print(f"{options.out}: {pluralize(done, 'decision')}; compare it with the best rule:")
    print(shlex.join(["drl-av", "evaluate", _driver_in(options.out), "gap-mobil"]))
    return 0


def _require_options_of_ppo(options: argparse.Namespace) -> None:
    """Raise ConfigError if an option is given that only Algorithm 1 has."""
    for option in ("episodes", "replay", "tensorboard", "reward", "sumo_options"):
        if getattr(options, option):
            length = ", whose length is -o ppo.decisions=N" if option == "episodes" else ""
            raise ConfigError(
                f"--{option.replace('_', '-')} belongs to the training by Algorithm 1, but this "
                f"one is PPO at scale{length}: leave it out, or choose another preset in a new "
                "folder."
            )


def _seed_jobs(options: argparse.Namespace) -> list[SeedJob]:
    """Return the training of each of ``--seeds``; with ``--resume`` those begun must be the same.

    Raises:
        RunError: a folder is not new, or was begun with other settings.
    """
    from drl_av.learning.run_folder import Run

    runs = {seed: Run(options.out / f"seed-{seed}") for seed in options.seeds}
    begun = {s: run.read_config() for s, run in runs.items() if run.config_file.is_file()}
    custom = custom_parts(options)
    for seed, stored in begun.items():
        if SeedJob(runs[seed].folder, stored, custom, options.tensorboard).is_stopped:
            raise RunError(
                f"{runs[seed].folder} holds a training at scale that was stopped, which cannot "
                "continue: move it away, and give the whole command again, with its settings."
            )
    if begun and not options.resume:
        raise RunError(
            f"{runs[next(iter(begun))].folder} exists already: continue it with --resume, or "
            "choose another folder with --out."
        )
    if options.resume and not begun:
        raise RunError(
            f"No run of these seeds has begun in {options.out}: leave --resume out, or name the "
            "folder of the runs with --out."
        )
    asked = _asked(options, next(iter(begun.values()), None))
    configs = {seed: asked.updated("learning", seed=seed) for seed in runs}
    for seed, stored in begun.items():
        _require_unchanged(runs[seed], stored, configs[seed])
    if asked.learning.algorithm == "ppo":
        _require_options_of_ppo(options)
    return [SeedJob(r.folder, configs[s], custom, options.tensorboard) for s, r in runs.items()]


def adapt(options: argparse.Namespace) -> int:
    """Continue to train a trained driver in a new run folder; return the exit status.

    This is the continual adaptation of Sec. IV-D of the paper. The verb is ``drl-av adapt``.
    """
    from drl_av.drivers.learned import is_actor
    from drl_av.drivers.policy_file import find_policy
    from drl_av.drivers.registry import find_driver
    from drl_av.env.custom import custom_inputs
    from drl_av.learning.run_folder import Run, open_training, warm_start
    from drl_av.learning.train import require_tensorboard

    if options.tensorboard:
        require_tensorboard()
    if options.resume and options.run is not None:
        raise ConfigError(
            f"--resume continues {options.out} with the driver that it began with: leave "
            f"{options.run} out."
        )
    word = "pretrained-paper" if options.run is None else options.run
    spec = find_driver(word)
    if spec.run is None:
        raise ConfigError(
            f"{word} is not a driver that drl-av trained: give a run's folder, "
            "or leave it out for pretrained-paper, which ships with drl-av."
        )
    policy = find_policy(spec.run, "pretrained-paper")
    if is_actor(policy):
        raise ConfigError(
            f"{word} learned by PPO, which has no continual adaptation: give a driver of Algorithm "
            "1, such as pretrained-paper."
        )
    config = _adaptation_config(options, Run(options.out), spec)

    custom, resume = custom_parts(options), options.resume

    def prepare(training: "Training") -> None:
        reward = custom_inputs(config, custom)["reward"]
        if not warm_start(training, policy, reward) and config.learning.learning_rate > 0:
            print(
                f"drl-av: {word} comes without the experience of its training: it learns "
                f"from {config.learning.collisions_to_start} collision rows on.",
                file=sys.stderr,
            )

    with open_training(options.out, config, custom, resume=resume, prepare=prepare) as opened:
        return _run("adapt", *opened, options, "idm" if resume else word)


def _stored(run: "Run") -> Config:
    """Return the settings of a run to resume; raise RunError if it is a training at scale."""
    stored = run.read_config()
    if stored.learning.algorithm == "ppo":
        raise RunError(
            f"{run.folder} holds a training at scale, which cannot continue: begin another one in "
            "a new folder, without --resume."
        )
    return stored


def _asked(options: argparse.Namespace, stored: Config | None) -> Config:
    """Return the settings that the command line of ``train`` asks for, or those ``stored``."""
    given = _given(options, "episodes", "seed", "replay")
    base = stored
    if base is None or options.preset is not None:
        base = preset("paper" if options.preset is None else options.preset)
    return with_command_line(base, options).updated("learning", **given)


def _adaptation_config(options: argparse.Namespace, run: "Run", spec: "DriverSpec") -> Config:
    from drl_av.drivers.registry import default_config, make_drivers

    given = _given(options, "episodes", "seed", "learning_rate")
    if options.resume:
        stored = _stored(run)
        config = with_command_line(stored, options).updated("learning", **given)
        _require_unchanged(run, stored, config)
        return config
    assert spec.trained_with is not None
    own, base = spec.trained_with.traffic, adaptation(default_config([spec]))
    most = {"vehicles_min": own.vehicles_min, "vehicles_max": own.vehicles_max}
    next_seed = (base.learning.seed + 1) % 2**32  # otherwise it meets the RUN's traffic again
    base = base.updated("traffic", **most).updated("learning", seed=next_seed)
    config = with_command_line(base, options).updated("learning", **given)
    make_drivers([spec], config)
    return config


def _given(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Return, by name, the values of those named options that the command line contains.

    Raises ConfigError if it sets one of them twice.
    """
    own = {name: f"learning.{name}" for name in names}
    require_one_word(options, {**own, "seeds": "learning.seed"})
    return {name: getattr(options, name) for name in names if getattr(options, name) is not None}


def _require_unchanged(run: "Run", stored: Config, asked: Config) -> None:
    if asked != stored:
        raise RunError(
            f"{run.folder} was begun with other settings than these options ask for: "
            "resume it without them, or begin a new run."
        )


def _run(
    verb: str, run: "Run", training: "Training", options: argparse.Namespace, rival: str
) -> int:
    """Train to the end or a stop, and print what to do next; return the exit status."""
    words = ["drl-av", verb, f"--out={run.folder}", "--resume", *_parts(options)]
    again = shlex.join([*words, "--tensorboard"] if options.tensorboard else words)
    try:
        finished = _watch(verb, run, training, options.tensorboard)
    except KeyboardInterrupt:
        finished = False
    except SimulationError as error:
        raise SimulationError(
            f"{str(error).removesuffix('.')}; the run continues from its last checkpoint "
            f"with: {again}."
        ) from error
    if not finished:
        print(f"drl-av: stopped; continue with: {again}", file=sys.stderr)
        return INTERRUPTED
    episodes = training.config.learning.episodes
    print(f"{run.folder}: {pluralize(episodes, 'episode')}; compare it with the driver {rival}:")
    print(shlex.join(["drl-av", "evaluate", _driver_in(run.folder), rival, *_checks(options)]))
    return 0


def _driver_in(folder: Path) -> str:
    """Return the word by which ``evaluate`` finds the driver in a run's folder."""
    from drl_av.drivers.registry import driver_names

    word = str(folder)
    return f"./{word}" if word in driver_names() or word.startswith("-") else word


def _parts(options: argparse.Namespace) -> list[str]:
    """Return the options of the command line that name the user's own parts, as words."""
    words = custom_parts(options).words()
    return [f"--{name.replace('_', '-')}={word}" for name, word in words.items()]


def _checks(options: argparse.Namespace) -> list[str]:
    """Return the option that names the user's own safety check, if there is one."""
    return [word for word in _parts(options) if word.startswith("--safety-check=")]


def _watch(verb: str, run: "Run", training: "Training", tensorboard: bool) -> bool:
    """Train with a progress bar; return True after the last episode, False after a stop."""
    from drl_av.cli.console import progress_bar, stop_request
    from drl_av.learning.run_folder import train
    from drl_av.learning.train import tensorboard_writer

    total, done = training.config.learning.episodes, training.episodes_done
    with (
        stop_request() as stop,
        tensorboard_writer(run.folder / "tensorboard" if tensorboard else None, done) as write,
        progress_bar(f"{verb}ing", total, done) as bar,
    ):
        for progress in train(run, training):
            write(progress)
            row, evaluation = progress
            bar.advance(
                f"reward {row.mean_reward:.3f}  {row.mean_speed_m_s:.1f} m/s  "
                f"triggers {row.safety_triggers}  epsilon {row.epsilon:.2f}",
                row.decisions,
            )
            if evaluation:
                bar.say(
                    f"episode {evaluation.episode}: greedy reward {evaluation.mean_reward:.3f}, "
                    f"{evaluation.mean_speed_m_s:.2f} m/s, "
                    f"{pluralize(evaluation.ego_hits, 'collision')} by the ego, "
                    f"{evaluation.safety_triggers:.1f} triggers an episode"
                )
            if stop.made and training.episodes_done < total:
                run.save(training)
                return False
    return True
