"""The study ``barricade``: learning beside a closed lane, with and without the safety check.

It corresponds to Sec. II-C of the paper, "Need for safety", and to Fig. 1a. Algorithm 1 is trained
with and without the check, on a highway whose right lane is closed. Then the greedy policies are
evaluated.
"""

from collections.abc import Sequence
from contextlib import closing
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.drivers.driver import Driver
from drl_av.driving.actions import Action
from drl_av.driving.maneuver import next_change
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics
from drl_av.env.rollout import rollout
from drl_av.env.transition import Transition
from drl_av.evaluation.figure_style import label_axes, panels
from drl_av.evaluation.statistics import grouped, mean_with_interval
from drl_av.evaluation.table import Inputs, read_rows
from drl_av.files.table import Row
from drl_av.road.road import Road, is_open
from drl_av.road.snapshot import CollisionKind
from studies.options import Call, Options, Plan, Program, Settings, order_by
from studies.results import markdown_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SETTINGS: Settings = {
    "simulation": {"scenario": "barricaded_right_lane", "world": "twin"},
    "traffic": {"kind": "paper"},
}
"""What differs from the preset ``paper``: a closed lane, and the traffic of Sec. IV-B."""
CHECKS = ("permit_all", "paper")
CHECK, SEED = itemgetter("safety_check"), itemgetter("seed")
SEEDS = (0, 1, 2, 3, 4)
EPISODES = {"permit_all": 10_000, "paper": 3000}
"""How many episodes of the paper's schedule of 10,000 a training drives, by its check."""
BLOCK = 100
"""Each row of ``barricade.csv`` sums this number of episodes."""
TRAINED_VEHICLES = 15
PHASES = ("training", "trained")
"""Values of the column ``phase``: the training with exploration; the greedy driver in one block of
episodes, on the seeds 0, 1, ..."""
STYLES = {"permit_all": ("#c2185b", "without a check"), "paper": ("#1976d2", "with the check")}
AVOIDED = 1e-3
"""A driver avoids the barricade if it enters the closed lane in at most this share of decisions."""


class BarricadeMetrics(EpisodeMetrics):
    """Computes the metrics of an episode, and counts the actions into the closed lane."""

    def __init__(self, road: Road, driver: Driver) -> None:
        super().__init__()
        self._road, self._driver = road, driver
        self.proposed = 0
        """Decisions in which the driver, which may explore, proposed to enter the closed lane."""
        self.chosen = 0
        """Decisions in which the greedy driver would have proposed it."""
        self.hit = ""
        """What the ego hit: "barricade", "road edge" or "vehicle".

        It is "by vehicle" if another vehicle hit the ego, and "" without a collision.
        """

    def add(self, decision: Transition) -> None:
        """Add the next decision of the episode."""
        super().add(decision)
        greedy = self._driver.act(decision.scene, decision.observation)
        self.proposed += self._enters_closed_lane(decision.scene, decision.proposed)
        self.chosen += self._enters_closed_lane(decision.scene, greedy)
        if decision.collision is not None:
            closed = self._enters_closed_lane(decision.scene, decision.executed)
            edge = "barricade" if closed else "road edge"
            vehicle = "vehicle" if decision.collision.kind.ego_hit else "by vehicle"
            self.hit = edge if decision.collision.kind is CollisionKind.HIT_EDGE else vehicle

    def _enters_closed_lane(self, scene: Scene, action: Action) -> bool:
        _, lane = next_change(*scene.lanes, scene.affordances.lane, action.lateral.sign)
        return 0 <= lane < len(self._road.open_lanes) and not is_open(lane, self._road)


def train_and_evaluate(task: tuple[Config, Sequence[Row]]) -> list[Row]:
    """Train a driver, then evaluate it; return a row for each block of episodes of both parts.

    ``task`` is the config and the keys of the rows. An interrupted training starts again from its
    beginning.
    """
    from drl_av.learning.algorithm_1 import build_training

    config, keys = task
    with closing(HighwayEnv(config=config)) as env:
        training, rows = build_training(env), []
        for key in keys:
            episodes = []
            for seed in range(min(BLOCK, int(key["episode"]))):
                metrics = BarricadeMetrics(env.road, training.driver)
                episodes.append(metrics)
                if key["phase"] == "training":
                    training.run_episode(metrics)
                else:
                    for decision in rollout(env, training.driver, seed, TRAINED_VEHICLES):
                        metrics.add(decision)
            rows.append(key | _summed(episodes))
    return rows


def _summed(episodes: Sequence[BarricadeMetrics]) -> Row:
    """Return the columns of a row that count decisions, or episodes with a collision."""
    hits = [metrics.hit for metrics in episodes]
    names = "decisions", "proposed", "chosen"
    counts = {name: sum(getattr(metrics, name) for metrics in episodes) for name in names} | {
        "hit_barricade": hits.count("barricade"),
        "hit_other": hits.count("road edge") + hits.count("vehicle"),
        "was_hit": hits.count("by vehicle"),
    }
    return {name: str(count) for name, count in counts.items()}


def _keys(config: Config, most_episodes: int) -> list[Row]:
    """Return the columns that say the place of each row of a training.

    The trained driver drives a block, but at most ``most_episodes``.
    """
    own = {"safety_check": config.safety.check, "seed": str(config.learning.seed)}
    last = min(EPISODES[config.safety.check], config.learning.episodes)
    block = min(BLOCK, last)
    ends = [("training", episode) for episode in range(block, last + 1, block)]
    return [
        {**own, "phase": phase, "episode": str(episode)}
        for phase, episode in [*ends, ("trained", min(block, most_episodes))]
    ]


def chosen_share(rows: Sequence[Row]) -> float:
    """Return the share of the decisions of ``rows`` in which the greedy driver enters the lane."""
    return sum(int(row["chosen"]) for row in rows) / sum(int(row["decisions"]) for row in rows)


def avoided_from(rows: Sequence[Row]) -> int | None:
    """Return the number of rows of a training after which its greedy driver avoids the barricade.

    In each later row the share of its choices into the closed lane is at most ``AVOIDED``. None if
    it is larger in the last row.
    """
    late = [place for place, row in enumerate(rows) if chosen_share([row]) > AVOIDED]
    first = late[-1] + 1 if late else 0
    return first if first < len(rows) else None


def barricade_plan(options: Options) -> Plan:
    """Return a plan with one training for each check and seed."""
    base = preset("paper")
    configs = [
        options.settings(base, SETTINGS, {"safety": {"check": check}, "learning": {"seed": seed}})
        for seed in SEEDS[: options.trainings(len(SEEDS))]
        for check in CHECKS
    ]
    tasks = [(config, _keys(config, options.episodes(BLOCK))) for config in configs]
    calls = [Call(task[1], train_and_evaluate, task) for task in tasks]
    place = order_by(seed=SEEDS, safety_check=CHECKS, phase=PHASES, episode=int)
    return Plan(Inputs({"": configs[0]}), place, calls=calls)


def barricade_table(folder: Path) -> str:
    """Return the Markdown table of the collisions with the barricade, by the check in training.

    A value is the mean over the trainings, with its 95 % confidence interval.
    """
    lines = []
    for check, own in grouped(read_rows(folder / "barricade.csv"), CHECK).items():
        trainings = [list(rows) for rows in grouped(own, SEED).values()]
        learnt = [[row for row in rows if row["phase"] == "training"] for rows in trainings]
        driven = [row for row in own if row["phase"] == "trained"]
        avoided = [avoided_from(rows) for rows in learnt]
        hits = mean_with_interval(sum(int(r["hit_barricade"]) for r in rows) for rows in learnt)
        before = [
            sum(int(row["hit_barricade"]) for row in rows[:first])
            for rows, first in zip(learnt, avoided, strict=True)
            if first is not None
        ]
        later = "hit_barricade", "episode"
        hit_later, driven_later = (sum(int(row[name]) for row in driven) for name in later)
        shares = mean_with_interval(100 * chosen_share(rows[-10:]) for rows in learnt)
        lines.append(
            [
                f"`{check}`",
                str(len(learnt)),
                f"{int(learnt[0][-1]['episode']):,}",
                f"{hits:,.0f}",
                f"{len(before)} of {len(learnt)}",
                f"{np.mean(before):,.0f}" if before else "-",
                f"{shares:.2f} %",
                f"{hit_later} of {driven_later}",
            ]
        )
    names = "check", "trainings", "episodes", "collisions with the barricade", "learned to avoid it"
    ends = ("after hits", "chosen in the last 1,000 episodes", "trained driver hit it")
    return markdown_table([*names, *ends], lines)


def barricade_figure(folder: Path) -> "Figure":
    """Draw the collisions with the barricade, and how often the greedy driver chooses its lane.

    Thin lines are trainings, bold ones their means.
    """
    rows = read_rows(folder / "barricade.csv")
    figure, (collisions, choices) = panels((11, 3.8), 1, 2)
    for check, own in grouped(rows, CHECK).items():
        color, label = STYLES[check]
        learnt = [row for row in own if row["phase"] == "training"]
        trainings = [list(rows) for rows in grouped(learnt, SEED).values()]
        hits = [np.cumsum([int(row["hit_barricade"]) for row in rows]) for rows in trainings]
        shares = [[100 * chosen_share([row]) for row in rows] for rows in trainings]
        episodes = [int(row["episode"]) for row in learnt[: len(hits[0])]]
        for axes, curves in ((collisions, hits), (choices, shares)):
            for curve in curves:
                axes.plot(episodes, curve, color=color, alpha=0.35, linewidth=1)
            axes.plot(episodes, np.mean(curves, axis=0), color=color, linewidth=2, label=label)
    label_axes(collisions, "training episode", "collisions with the barricade so far")
    label_axes(choices, "training episode", "greedy choices of the closed lane, %")
    collisions.legend(frameon=False)
    for axes in (collisions, choices):
        axes.set_ylim(bottom=-0.02 * axes.get_ylim()[1])
    return figure


BARRICADE = Program(
    name="barricade",
    meaning="learning beside a closed lane, with the check and without (Fig. 1a)",
    row="a hundred episodes of a training, or of the driver that it trained",
    plan=barricade_plan,
    tables={"barricade": barricade_table},
    figures={"barricade": barricade_figure},
)
