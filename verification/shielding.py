"""Compares three ways to use a safety check in the training of an agent.

    python -m verification.shielding --seeds 10 --out docs/results/shielding.csv

masking                  the agent chooses only among the permitted actions
replacement              the check replaces a refused action by another one
replacement and penalty  the same, and each refused action reduces the reward

The agent is PPO of sb3-contrib with its default settings, the check is ``strict``, the environment
is ``drl_av/Highway-v0``. The comparison follows Krasowski et al., arXiv:2205.06750. A training
writes its rows when it is complete. If the command is repeated, it does only the trainings that the
table lacks. Each training draws the traffic of its episodes from its own seed. Its final greedy
policy is evaluated in traffic that is the same for all trainings.
"""

from collections.abc import Iterable, Iterator
from contextlib import closing
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.drivers.checked import PolicyDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.env.scene_values import Observation
from drl_av.env.transition import Transition
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.provenance import provenance, read_provenance, write_provenance
from drl_av.files.atomic import require_writable
from drl_av.files.table import append_rows, read_table
from verification.program import Program, run_program
from verification.shielding_report import COLUMNS, FINAL, METHODS, TRAINING, figure, table

PENALTY = 0.5
"""Amount by which a refused action reduces the reward, in the method with a penalty."""
BIN = 5_000
"""Each row of a training holds means over this number of decisions."""
SETTINGS: dict[str, Any] = {}
"""Settings of the agent that differ from the defaults of sb3-contrib: none."""
EVALUATION_SEED = 930_000
"""First traffic seed of the evaluation; besides it only ``twin_equality`` uses these seeds."""


class Decided(NamedTuple):
    """One decision of a training."""

    reward: float
    """The paper's reward, without a penalty."""
    speed_m_s: float
    refused: bool
    ego_hit: bool


class PenalizedReward:
    """Computes the paper's reward minus a penalty for a refused action; records each decision."""

    def __init__(self, penalty: float) -> None:
        self.penalty = penalty
        self.decided: list[Decided] = []

    def __call__(self, outcome: Transition) -> float:
        refused = outcome.executed != outcome.proposed
        hit = outcome.collision is not None and outcome.collision.kind.ego_hit
        speed_m_s = outcome.next_scene.affordances.ego_speed_m_s
        self.decided.append(Decided(outcome.reward, speed_m_s, refused, hit))
        return outcome.reward - self.penalty * refused


def greedy(model: Any, env: HighwayEnv, masking: bool) -> PolicyDriver:
    """Return the greedy driver of an agent; with ``masking`` it chooses only permitted actions."""

    def policy(observation: Observation) -> int:
        masks = env.action_masks() if masking else None
        return int(model.predict(observation, action_masks=masks, deterministic=True)[0])

    return PolicyDriver(policy)


def trained(method: str, seed: int, steps: int, episodes: int) -> Iterator[dict[str, Any]]:
    """Train one agent for ``steps`` decisions, then evaluate it; yield the rows of both parts.

    The evaluation has ``episodes`` episodes at each number of vehicles.
    """
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.utils import set_random_seed

    set_random_seed(seed)
    masking, calm = method == "masking", Config().with_traffic("calm")
    config = calm.updated("safety", check="strict")
    reward = PenalizedReward(PENALTY if method == "replacement and penalty" else 0.0)
    key = {"method": method, "seed": seed}
    with closing(HighwayEnv(config=config, reward=reward)) as env:
        model = MaskablePPO("MlpPolicy", env, seed=seed, device="cpu", **SETTINGS)
        model.learn(steps, use_masking=masking)
        for begin in range(0, steps - BIN + 1, BIN):
            yield {**key, "stage": TRAINING, "step": begin + BIN} | means(
                reward.decided[begin : begin + BIN]
            )
    with closing(HighwayEnv(config=config)) as env:
        agent = greedy(model, env, masking)
        for vehicles in DENSITIES:
            seeds = range(EVALUATION_SEED, EVALUATION_SEED + episodes)
            results = [drive(env, agent, method, number, vehicles) for number in seeds]
            decisions = sum(result.decisions for result in results)
            yield {
                **key,
                "stage": FINAL,
                "step": vehicles,
                "mean_reward": mean(result.mean_reward for result in results),
                "mean_speed_m_s": mean(result.mean_speed_m_s for result in results),
                "refused_share": sum(result.safety_triggers for result in results) / decisions,
                "ego_hits": sum(result.ego_hit for result in results),
            }


def means(decided: list[Decided]) -> dict[str, float]:
    """Return the means over some decisions, and their number of collisions, by table column."""
    *columns, hits = zip(*decided, strict=True)
    return {**dict(zip(COLUMNS[4:], map(mean, columns), strict=False)), "ego_hits": sum(hits)}


def mean(values: Iterable[float]) -> float:
    return float(np.mean([*values]))


def main() -> int:
    """Do the missing trainings, then write the figure and print the table; return 0."""
    parser = Program(__doc__)
    parser.some("--methods", METHODS)
    parser.number("--seeds", 10, "trainings of each method")
    parser.number("--steps", 50_000, "decisions of a training", low=BIN)
    parser.number("--episodes", 5, "evaluated at each density")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.csv")
    options = parser.parse_args()
    require_writable(options.out)
    if not options.out.parent.is_dir():
        parser.error(f"The folder {options.out.parent} does not exist: make it first.")
    size = {"steps": options.steps, "evaluation_episodes": options.episodes}
    rows, facts = read_table(options.out, growing=True), read_provenance(options.out)
    if facts and any(facts.get(name) != number for name, number in size.items()):
        parser.error(f"{options.out} was made with other --steps or --episodes: choose another")
    before_s = facts.get("wall_time_s", 0.0)
    known = {(row["method"], int(row["seed"])) for row in rows}
    for seed, method in product(range(options.seeds), options.methods):
        if (method, seed) not in known:
            made = list(trained(method, seed, options.steps, options.episodes))
            spent_s = round(before_s + parser.spent_s(), 1)
            how = provenance(Config(), **size, penalty=PENALTY, wall_time_s=spent_s)
            write_provenance(options.out, how)
            append_rows(options.out, COLUMNS, made)
    rows = read_table(options.out, growing=True)
    figure(rows, options.out.with_suffix(".png"))
    print(table(rows))
    print(parser.made_by(before_s))
    return 0


if __name__ == "__main__":
    run_program(main)
