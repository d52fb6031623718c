"""Trains variants of the preset ``large`` in the twin, and measures what each choice is worth.

``python -m studies.ablation`` continues where it stopped: it does not train a policy that exists
again, nor make a row again. Each policy drives in the twin under ``strict``, beside ``gap-mobil``
in the same traffic.
"""

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import safetensors.numpy
from threadpoolctl import threadpool_limits

from drl_av.arrays import BoolArray, Float32Array, FloatArray, IntArray
from drl_av.cli.console import exit_status
from drl_av.cli.options import int_at_least
from drl_av.config import SINGLE_PRESETS, Config
from drl_av.config.presets import PRESETS
from drl_av.drivers.network import forward
from drl_av.drivers.policy_file import load
from drl_av.drivers.registry import rule_driver
from drl_av.driving.actions import ACTIONS
from drl_av.driving.affordances import INDICATORS
from drl_av.driving.wide_observation import WIDE_SIZE
from drl_av.errors import DrlAvError
from drl_av.evaluation.engines import end_with
from drl_av.files.atomic import replacing
from drl_av.files.table import append_rows, column_types, read_table
from drl_av.learning.large_scale import learner_of, save_actor
from drl_av.learning.twin_worlds import Part, TwinWorlds
from studies.options import RESULTS

DECISIONS = 4_000_000
"""Decisions of a training."""
COUNTS = 5, 10, 15, 20, 25
FIRST_SEED, EPISODES = 870_000, 100
RULE = "gap-mobil"
NOTHING = np.zeros(0, np.float32)
PRESET = PRESETS["large"].updated("ppo", hidden_1=192, hidden_2=128, decisions=13_000_000)
"""The preset ``large`` of version 0.9.0, of which the published trainings are."""


class IndicatorWorlds(TwinWorlds):
    """The policy sees the paper's 27 indicators in place of the wide observation."""

    SIZE = len(INDICATORS) + len(ACTIONS)

    def look(self, part: Part, worlds: IntArray) -> None:
        """Update the observations and the masks of some worlds of one part."""
        episodes = part.env.episodes
        mask = episodes.executed[worlds] == np.arange(len(ACTIONS))
        seen = episodes.observation[worlds], mask
        self.observation[part.rows][worlds] = np.concatenate(seen, axis=1, dtype=np.float32)
        self.permitted[part.rows][worlds] = mask | ~mask.any(axis=1, keepdims=True)


class TwoSecondWorlds(TwinWorlds):
    """The policy sees the wide observation of the decision before, too."""

    SIZE = WIDE_SIZE + TwinWorlds.SIZE

    def look(self, part: Part, worlds: IntArray) -> None:
        """Update the observations and the masks of some worlds of one part."""
        now = np.zeros((part.env.num_envs, TwinWorlds.SIZE), np.float32)
        self.see(part, worlds, now)
        now, before = now[worlds], self.observation[part.rows][worlds, WIDE_SIZE : 2 * WIDE_SIZE]
        begins = part.env.episodes.decisions[worlds, np.newaxis] == 0
        before = np.where(begins, now[:, :WIDE_SIZE], before)
        self.observation[part.rows][worlds] = np.concatenate((before, now), axis=1)


class PaperPart(Part):
    """Pays the paper's reward, eq. 7 to 9."""

    def step(self, action: IntArray) -> tuple[Float32Array, BoolArray, BoolArray]:
        """Execute one action in each world; return the rewards, and which egos hit and are late."""
        _, reward, terminated, truncated, _ = self.env.step(action)
        self.collisions += int(terminated.sum())
        return reward.astype(np.float32), terminated, truncated & ~terminated


class PaperRewardWorlds(TwinWorlds):
    """The driver is paid the paper's reward."""

    PART = PaperPart


class TwoCheckWorlds(TwinWorlds):
    """Half of the worlds of each kind of traffic drive under the check ``paper``."""

    @staticmethod
    def kinds(config: Config) -> list[Config]:
        """Return the settings of which each drives an equal part of the worlds."""
        found = TwinWorlds.kinds(config)
        return [
            kind.updated("safety", check=name) for kind in found for name in ("strict", "paper")
        ]


class Variant(NamedTuple):
    """One choice that differs from the preset, and its words in the figure."""

    words: str
    changes: Callable[[Config], Config] = lambda config: config
    worlds: type[TwinWorlds] = TwinWorlds
    trainings: int = 1
    """Number of trainings in the published table."""


def _ppo(**settings: object) -> Callable[[Config], Config]:
    return lambda config: config.updated("ppo", **settings)


COSTS = "abort_cost", "reversal_cost", "hard_brake_cost", "short_headway_cost", "forced_brake_cost"
VARIANTS = {
    "lanes": Variant("the preset", _ppo(lane_units=PRESET.ppo.lane_units), trainings=2),
    "large": Variant("no layer that lanes share", trainings=2),
    "both": Variant("checks strict and paper", worlds=TwoCheckWorlds),
    "indicators": Variant("27 indicators", worlds=IndicatorWorlds),
    "two-seconds": Variant("the second before, too", worlds=TwoSecondWorlds, trainings=2),
    "paper-reward": Variant("the paper's reward", worlds=PaperRewardWorlds),
    "symmetric": Variant("the critic sees no more", _ppo(asymmetric_critic=False), trainings=2),
    "trace-95": Variant("trace decay 0.95", _ppo(gae_lambda=0.95), trainings=2),
    "discount-90": Variant("discount 0.90", _ppo(discount=0.9)),
    "discount-95": Variant("discount 0.95", _ppo(discount=0.95)),
    "discount-99": Variant("discount 0.99", _ppo(discount=0.99)),
    "discount-995": Variant("discount 0.995", _ppo(discount=0.995)),
    "no-costs": Variant("speed alone", _ppo(**dict.fromkeys(COSTS, 0.0)), trainings=2),
    "calm": Variant(
        "calm traffic alone", lambda config: config.updated("traffic", presets=("calm",))
    ),
    "wider": Variant("layers of 384 and 256", _ppo(hidden_1=384, hidden_2=256), trainings=2),
}


class Row(NamedTuple):
    """What one policy gains over ``gap-mobil``, in one kind of traffic."""

    variant: str
    seed: int
    traffic: str
    gain_m_s: float
    """Mean over 5 to 25 vehicles of the difference of the mean speeds, paired by traffic seed."""
    ego_hits: int


def settings(variant: str, seed: int) -> Config:
    """Return the settings of a training."""
    preset = PRESET.updated("ppo", decisions=DECISIONS, lane_units=0)
    return VARIANTS[variant].changes(preset.updated("learning", seed=seed))


def train(runs: Path, job: tuple[str, int]) -> None:
    """Train a variant with a seed, and save its policy."""
    config, path = settings(*job), _policy_file(runs, job)
    if is_trained(path, config):
        return
    learner = learner_of(config, VARIANTS[job[0]].worlds(config, job[1]))
    while learner.num_timesteps < DECISIONS // config.ppo.batch_size * config.ppo.batch_size:
        learner.learn(config.ppo.batch_size, reset_num_timesteps=False)
    save_actor(path, learner, config)


def is_trained(path: Path, config: Config) -> bool:
    """Whether a policy file exists; raises DrlAvError if it was trained with other settings."""
    if path.exists() and load(path)[1]["config"] != config.to_toml():
        raise DrlAvError(
            f"{path} was trained with other settings: choose another folder with --runs, or move "
            "it away."
        )
    return path.exists()


def speeds(kind: str, kept: Path | None, base: type[TwinWorlds]) -> tuple[FloatArray, int]:
    """Return the ego's mean speeds, shape (counts, episodes), m/s, and the number of its hits.

    ``kept`` is the policy's file; without one the rule drives.
    """
    config = PRESET.updated("traffic", presets=(kind,))
    worlds = base(config.updated("ppo", worlds=EPISODES * len(base.kinds(config))), 0)
    part, everywhere = worlds.parts[0], np.arange(EPISODES)
    layers, rule = [], rule_driver(RULE, config.with_traffic(kind))
    if kept is not None:
        found = safetensors.numpy.load_file(kept)
        layers = [
            (found[f"layers.{i}.weight"], found[f"layers.{i}.bias"]) for i in range(len(found) // 2)
        ]
    rows, hits = [], 0
    for count in COUNTS:
        seeds = [FIRST_SEED + row for row in everywhere.tolist()]
        part.env.reset(seed=seeds, options={"vehicles": count})
        driven, decisions = np.zeros(EPISODES), np.zeros(EPISODES)
        goes_on = np.ones(EPISODES, np.bool_)
        while goes_on.any():
            worlds.look(part, everywhere)
            if kept is None:
                scenes = map(part.env.scene, range(EPISODES))
                action = np.array([rule.act(scene, NOTHING).number for scene in scenes])
            else:
                logits = forward(layers, worlds.observation[part.rows])[1]
                action = np.where(worlds.permitted[part.rows], logits, -np.inf).argmax(axis=1)
            _, hit, late = part.step(action)
            driven += part.env.episodes.scene[:, 2, 0] * goes_on
            decisions += goes_on
            hits += int((hit & goes_on).sum())
            goes_on &= ~(hit | late)
            part.begin_anew(hit | late)
        rows.append(driven / decisions)
    return np.array(rows), hits


def measure(runs: Path, job: tuple[str, int]) -> list[Row]:
    """Return the rows of one policy, a row for each kind of traffic."""
    base, policy = VARIANTS[job[0]].worlds, _policy_file(runs, job)
    found = [gain(runs, kind, policy, base) for kind in SINGLE_PRESETS]
    return [Row(*job, *row) for row in zip(SINGLE_PRESETS, *zip(*found, strict=True), strict=True)]


def gain(runs: Path, kind: str, policy: Path, base: type[TwinWorlds]) -> tuple[float, int]:
    """Return the gain of a policy in a kind of traffic, m/s, and the number of the ego's hits.

    ``runs`` has what ``drive_rule`` wrote.
    """
    found, hits = speeds(kind, policy, base)
    return round(float((found - np.load(_rule_file(runs, kind))).mean()), 4), hits


def drive_rule(runs: Path, kind: str) -> None:
    """Drive the rule in the traffic of all policies, once."""
    if not _rule_file(runs, kind).exists():
        with replacing(_rule_file(runs, kind)) as unfinished:
            np.save(unfinished, speeds(kind, None, TwinWorlds)[0])


def _policy_file(runs: Path, job: tuple[str, int]) -> Path:
    return runs / "{}-{}.safetensors".format(*job)


def _rule_file(runs: Path, kind: str) -> Path:
    return runs / f"{RULE}-{kind}.npy"


def gains(rows: Sequence[dict[str, Any]], by: str) -> Any:
    """Return a data frame of mean gains: a row for each value of the column ``by``."""
    found = pd.DataFrame(rows).pivot_table("gain_m_s", by, "traffic")[[*SINGLE_PRESETS]]
    return found.assign(mean=found.mean(axis=1)).rename_axis(index=None, columns=by)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the gain of each variant, the mean of its trainings, in each kind of traffic."""
    found = gains(rows, "variant")
    found["trainings"] = pd.DataFrame(rows).groupby("variant")["seed"].nunique()
    found = found.loc[sorted(found.index, key=[*VARIANTS].index)]
    found.index = [VARIANTS[name].words for name in found.index]
    return str(found.to_string(float_format="{:.2f}".format))


def command_line(name: str, doc: str | None, seeds: Sequence[int] = ()) -> argparse.ArgumentParser:
    """Return the parser of a study of trainings."""
    parser = argparse.ArgumentParser(f"python -m studies.{name}", description=doc)
    parser.add_argument("--seeds", nargs="+", type=int, default=seeds)
    parser.add_argument("--jobs", type=int_at_least(1), default=2)
    parser.add_argument("--runs", type=Path, default=Path("runs/studies") / name)
    parser.add_argument("--out", type=Path, default=RESULTS / f"{name}.csv")
    return parser


def begin(parent: int) -> None:
    """Let this process use one thread, and end with ``parent``."""
    threadpool_limits(1, "blas")
    end_with(parent)


def complete(
    given: argparse.Namespace,
    row: type,
    jobs: Iterable[tuple[Any, ...]],
    train: Callable[[Path, Any], None],
    measure: Callable[[Path, Any], Sequence[Any]],
) -> list[dict[str, Any]]:
    """Train what the table lacks, measure it, and return all rows.

    The first fields of each row, a NamedTuple ``row``, are those of its job.
    """
    given.runs.mkdir(parents=True, exist_ok=True)
    known = [[*each.values()] for each in read_table(given.out, column_types(row), growing=True)]
    missing = [job for job in jobs if [*job] not in [each[: len(job)] for each in known]]
    if missing:
        with ProcessPoolExecutor(given.jobs, initializer=begin, initargs=(os.getpid(),)) as pool:
            list(pool.map(partial(drive_rule, given.runs), SINGLE_PRESETS))
            list(pool.map(partial(train, given.runs), missing))
            for found in pool.map(partial(measure, given.runs), missing):
                append_rows(given.out, row, found)
    return read_table(given.out, column_types(row))


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status 0."""
    parser = command_line("ablation", __doc__)
    parser.add_argument("--variants", nargs="+", choices=VARIANTS, default=[*VARIANTS])
    given = parser.parse_args(words)
    jobs = [
        (name, seed)
        for name in given.variants
        for seed in given.seeds or range(VARIANTS[name].trainings)
    ]
    rows = complete(given, Row, jobs, train, measure)
    print(f"gain over gap-mobil under strict, m/s, in the twin, after {DECISIONS:,} decisions")
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(exit_status("studies.ablation", main))
