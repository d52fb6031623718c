"""Measures how long three agents train until they drive well.

    python -m verification.time_to_quality

fast   the preset fast
dqn    stable-baselines3's DQN with the hyperparameters of ``examples/rl_zoo3.yml``; its reward is
       the paper's, minus the ``learning.unsafe_penalty`` of ``fast`` for each replaced action
qrdqn  the same with distributional targets: QR-DQN of sb3-contrib (Dabney et al. 2018), with 25
       quantiles; its default of 200 takes many times as long

All make 40,000 decisions in the same kind of traffic under the check ``paper``. After every 2,000
decisions the networks are copied. When the training has ended, each copy drives the same 14
episodes, in traffic that no training uses. Seconds are CPU seconds of the process while it trains;
they exclude the evaluations. Leave a core free for the program: on a machine with too many programs
CPU seconds grow as well. If the command is repeated, it does only the trainings that the table
lacks.
"""

import copy
import math
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from itertools import groupby, product
from operator import itemgetter
from pathlib import Path
from statistics import fmean, median
from typing import Any

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.drivers.checked import PolicyDriver
from drl_av.drivers.driver import Driver
from drl_av.drivers.learned import learned_driver
from drl_av.drivers.rule_based import RandomDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.errors import pluralize
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.provenance import provenance, write_sidecar
from drl_av.evaluation.statistics import mean_with_interval
from drl_av.files import Row, append_rows, read_table
from studies.results import ResultsFolder, markdown_table
from verification.program import Program, run_program
from verification.shielding import PenalizedReward

TRIAL = 4
"""The trial of ``tools/tune_rl_zoo3.py`` whose hyperparameters are in ``examples/rl_zoo3.yml``."""
CHECKPOINTS, EPISODES = 20, 10
"""Number of evaluations of a training, and of training episodes before each."""
TRAFFIC, DRIVES = 940_000, 2
"""First traffic seed of the evaluations, and their episodes at each number of vehicles."""
QUALITIES = {
    "mean_speed_m_s": ("mean speed, m/s", 2),
    "mean_reward": ("reward per decision", 3),
    "safety_triggers": ("safety triggers an episode", 1),
}
SHARES = (0.9, 0.99)
"""The thresholds, as shares of the gain of the final drivers of ``fast`` over the random driver."""
TABLE = "time_to_quality.csv"
COLUMNS = ("agent", "seed", "checkpoint", "cpu_s", *QUALITIES, "ego_hits")
Drivers = list[tuple[float, Driver]]
"""The drivers of a training after each checkpoint, with the CPU seconds since its start."""


def fast(seed: int) -> Drivers:
    """Train with the preset ``fast``; return the drivers of its checkpoints."""
    from drl_av.learning.algorithm_1 import build_training

    drivers: Drivers = []
    config = preset("fast").updated("learning", seed=seed)
    with closing(HighwayEnv(config=config)) as env:
        training = build_training(env)
        begun_s = time.process_time()
        for _ in range(CHECKPOINTS):
            for _ in range(EPISODES):
                training.run_episode()
            cpu_s = time.process_time() - begun_s
            networks = copy.deepcopy(training.networks)
            drivers.append((cpu_s, learned_driver(networks, config)))
    return drivers


def stable_baselines3(name: str, seed: int) -> Drivers:
    """Train the agent ``name``, dqn or qrdqn; return the drivers of its checkpoints."""
    import torch
    from sb3_contrib import QRDQN
    from stable_baselines3 import DQN

    from tools.tune_rl_zoo3 import BY_HAND, draw

    torch.set_num_threads(1)
    drivers: Drivers = []
    config = Config().with_traffic("calm")
    every = EPISODES * config.simulation.decisions_per_episode

    def keep(*_: object) -> bool:
        if agent.num_timesteps % every == 0:
            policy = copy.deepcopy(agent.policy)
            driver = PolicyDriver(lambda seen: int(policy.predict(seen, deterministic=True)[0]))
            drivers.append((time.process_time() - begun_s, driver))
        return True

    reward = PenalizedReward(preset("fast").learning.unsafe_penalty)
    with closing(HighwayEnv(config=config, reward=reward)) as env:
        settings = BY_HAND | draw(TRIAL + 1)[TRIAL]
        if name == "qrdqn":
            settings["policy_kwargs"] = settings["policy_kwargs"] | {"n_quantiles": 25}
        make = {"dqn": DQN, "qrdqn": QRDQN}[name]
        agent = make("MlpPolicy", env, seed=seed, device="cpu", **settings)
        begun_s = time.process_time()
        agent.learn(CHECKPOINTS * every, callback=keep)
    return drivers


TRAINED: dict[str, Callable[[int], Drivers]] = {
    "fast": fast,
    "dqn": partial(stable_baselines3, "dqn"),
    "qrdqn": partial(stable_baselines3, "qrdqn"),
}


def rows_of(agent: str, seed: int) -> list[dict[str, Any]]:
    """Train an agent, if it learns, and evaluate its checkpoints; return their rows."""
    rows, drivers = [], TRAINED[agent](seed) if agent in TRAINED else [(0.0, RandomDriver())]
    with closing(HighwayEnv(config={"traffic": {"kind": "calm"}})) as env:
        for number, (cpu_s, driver) in enumerate(drivers, start=1):
            results = [
                drive(env, driver, agent, TRAFFIC + episode, vehicles)
                for vehicles in DENSITIES
                for episode in range(DRIVES)
            ]
            row = {"agent": agent, "seed": seed, "checkpoint": number, "cpu_s": f"{cpu_s:.1f}"}
            for name in QUALITIES:
                row[name] = f"{fmean(getattr(each, name) for each in results):.6g}"
            rows.append({**row, "ego_hits": sum(each.ego_hit for each in results)})
    return rows


def kept_s(rows: list[Row], name: str, threshold: float, origin: float) -> float:
    """Return the CPU seconds of the checkpoint from which on all checkpoints reach a threshold.

    ``rows`` are the checkpoints of one training. One of them reaches the threshold if its quality
    ``name`` is not on the side of ``origin``, the value of the random driver. The result is inf if
    the last checkpoint does not reach the threshold.
    """
    sign = 1.0 if threshold > origin else -1.0
    missed = [sign * (float(row[name]) - threshold) < 0 for row in rows]
    kept = rows[len(rows) - missed[::-1].index(True) :] if any(missed) else rows
    return float(kept[0]["cpu_s"]) if kept else math.inf


def spread(seconds: Sequence[float]) -> str:
    """Return the median, the smallest and the largest of some times as text."""
    three = median(seconds), min(seconds), max(seconds)
    middle, low, high = (f"{each:.0f}" if math.isfinite(each) else "never" for each in three)
    return f"{middle} ({low} to {high})"


def section(results: ResultsFolder) -> str:
    """Return the Markdown table of times and final values, or a note if trainings are missing."""
    runs: dict[str, list[list[Row]]] = {"random": [], **{agent: [] for agent in TRAINED}}
    for (agent, _), own in groupby(results.rows(TABLE), itemgetter("agent", "seed")):
        runs[agent].append(list(own))
    if not all(runs.values()):
        return "*The trainings have not been made yet.*"
    [[start]] = runs.pop("random")
    lines, ends = [], []
    final = {
        name: [mean_with_interval(float(own[-1][name]) for own in each) for each in runs.values()]
        for name in QUALITIES
    }
    for share in SHARES:
        times: list[list[list[float]]] = []
        for name, (label, digits) in QUALITIES.items():
            origin = float(start[name])
            at = origin + share * (final[name][0].value - origin)
            times.append([[kept_s(own, name, at, origin) for own in e] for e in runs.values()])
            lines.append([f"{share:.0%}: {label} {at:.{digits}f}", *map(spread, times[-1])])
        whole = [[max(own) for own in zip(*each, strict=True)] for each in zip(*times, strict=True)]
        lines.append([f"{share:.0%}: all three", *map(spread, whole)])
    for name, (label, digits) in QUALITIES.items():
        shown = [(f"{each.value:.{digits}f}", each.half_width) for each in final[name]]
        cells = [f"{mean} ± {half:.{digits}f}" if half < math.inf else mean for mean, half in shown]
        ends.append([f"final {label}", *cells])
    spent = [spread([float(own[-1]["cpu_s"]) for own in each]) for each in runs.values()]
    names = [f"`{agent}`, {pluralize(len(each), 'training')}" for agent, each in runs.items()]
    return markdown_table(["", *names], [*lines, ["the whole training", *spent], *ends])


def main() -> int:
    """Do the missing trainings and print the table; return 0."""
    parser = Program(__doc__)
    parser.number("--seeds", 5, "of each agent")
    parser.add_argument("--out", type=Path, default=Path("docs/results"), metavar="FOLDER")
    options = parser.parse_args()
    table = options.out / TABLE
    known = {(row["agent"], int(row["seed"])) for row in read_table(table, growing=True)}
    for seed, agent in [(0, "random"), *product(range(options.seeds), TRAINED)]:
        if (agent, seed) not in known:
            rows = rows_of(agent, seed)
            write_sidecar(table, provenance(Config()))
            append_rows(table, COLUMNS, rows)
    print(section(ResultsFolder(options.out)), parser.made_by(), sep="\n")
    return 0


if __name__ == "__main__":
    run_program(main)
