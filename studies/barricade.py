"""The study ``barricade``: learning beside a closed lane, with and without the safety check.

It corresponds to Sec. II-C of the paper, "Need for safety". The same agent is trained with and
without the check, on a highway whose right lane is closed. Then the greedy policies are evaluated.
"""

from collections.abc import Sequence
from contextlib import closing
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.driving.actions import Action
from drl_av.driving.maneuver import target_lane
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics
from drl_av.env.rollout import rollout
from drl_av.env.transition import Transition
from drl_av.evaluation.figure_style import label_axes, panels
from drl_av.evaluation.statistics import grouped
from drl_av.evaluation.table import Inputs, order_by
from drl_av.files import Row
from drl_av.road.road import Road
from drl_av.road.snapshot import CollisionKind
from studies.options import Call, Options, Plan, Program
from studies.results import ResultsFolder

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SCENARIO = "barricaded_right_lane"
CHECKS = ("permit_all", "paper")
SEEDS = (0, 1)
EPISODES = 120
TRAINED_EPISODES, TRAINED_VEHICLES = 20, 15
PHASES = ("training", "trained")
"""Values of the column ``phase``: the training with exploration; the greedy driver's evaluation on
the seeds 0, 1, ..."""
STYLES = {"permit_all": ("#c2185b", "without a check"), "paper": ("#1976d2", "with the check")}


class BarricadeMetrics(EpisodeMetrics):
    """Computes the metrics of an episode, and counts the proposals to enter the closed lane."""

    def __init__(self, road: Road) -> None:
        super().__init__()
        self._road = road
        self.barricade_proposals = 0
        self.hit = ""
        """What the ego hit: "barricade", "road edge" or "vehicle".

        It is "by vehicle" if another vehicle hit the ego, and "" without a collision.
        """

    def add(self, decision: Transition) -> None:
        """Add the next decision of the episode."""
        super().add(decision)
        self.barricade_proposals += self._enters_closed_lane(decision.scene, decision.proposed)
        if decision.collision is not None:
            closed = self._enters_closed_lane(decision.scene, decision.executed)
            edge = "barricade" if closed else "road edge"
            vehicle = "vehicle" if decision.collision.kind.ego_hit else "by vehicle"
            self.hit = edge if decision.collision.kind is CollisionKind.HIT_EDGE else vehicle

    def _enters_closed_lane(self, scene: Scene, action: Action) -> bool:
        lane = target_lane(scene, action.lateral)
        return 0 <= lane < len(self._road.open_lanes) and not self._road.is_open(lane)


def barricade_config(check: str, seed: int, episodes: int) -> Config:
    """Return the config of a training beside the closed lane: a simplified preset ``fast``.

    The training has one network, and few of our additions to the paper's algorithm.
    """
    plain = {"networks": 1, "batch_size": 64, "learning_rate": 2e-3, "counterfactuals": 0}
    plain |= {"discount": 0.9, "speed_weight": 0.0, "unsafe_penalty": 0.0, "lane_change_margin": 0}
    plain |= {"evaluate_every": 100}
    fast = preset("fast").updated("learning", seed=seed, episodes=episodes, **plain)
    return fast.updated("simulation", scenario=SCENARIO).updated("safety", check=check)


def train_and_evaluate(config: Config) -> list[Row]:
    """Train a driver, then evaluate it; return a row for each episode of both parts.

    An interrupted training starts again from its beginning.
    """
    from drl_av.learning.algorithm_1 import build_training

    with closing(HighwayEnv(config=config)) as env:
        training, rows = build_training(env), []
        keys = _keys(config)
        for key in keys:
            metrics = BarricadeMetrics(env.road)
            if key["phase"] == "training":
                training.run_episode(metrics)
            else:
                seed = int(key["episode"]) - 1
                for decision in rollout(env, training.driver, seed, TRAINED_VEHICLES):
                    metrics.add(decision)
            counts = {"decisions": metrics.decisions}
            counts["barricade_proposals"] = metrics.barricade_proposals
            rows.append(key | {name: str(n) for name, n in counts.items()} | {"hit": metrics.hit})
    return rows


def _keys(config: Config) -> list[Row]:
    """Return the columns that say the place of each row of a training."""
    driven = (config.learning.episodes, TRAINED_EPISODES)
    own = {"safety_check": config.safety.check, "seed": str(config.learning.seed)}
    return [
        {**own, "phase": phase, "episode": str(episode)}
        for phase, count in zip(PHASES, driven, strict=True)
        for episode in range(1, count + 1)
    ]


def barricade_plan(options: Options) -> Plan:
    """Return a plan with one training of ``EPISODES`` episodes for each check and seed."""
    configs = [
        options.with_files(barricade_config(check, seed, EPISODES))
        .updated("simulation", scenario=SCENARIO)
        .updated("safety", check=check)
        .updated("learning", seed=seed)
        for seed in SEEDS[: options.trainings(len(SEEDS))]
        for check in CHECKS
    ]
    calls = [Call(_keys(config), train_and_evaluate, config) for config in configs]
    place = order_by(seed=SEEDS, safety_check=CHECKS, phase=PHASES, episode=int)
    return Plan(Inputs({"": configs[0]}, {"": None}), place, calls=calls)


def barricade_figure(folder: Path) -> "Figure":
    """Draw two panels on the closed lane, each with and without the safety check.

    The left panel shows the collisions with the barricade in the trainings. The right panel shows
    how often the trained drivers propose to enter the closed lane.
    """
    rows = ResultsFolder(folder).rows("barricade.csv")
    figure, (learning, trained) = panels((9, 3.8), 1, 2, width_ratios=(3, 2))
    for place, (check, own) in enumerate(grouped(rows, itemgetter("safety_check")).items()):
        color, label = STYLES[check]
        _draw_learning(learning, [row for row in own if row["phase"] == "training"], color, label)
        bar = (place, label, color)
        _draw_trained(trained, [row for row in own if row["phase"] == "trained"], bar)
    label_axes(learning, "training episode", "collisions with the barricade so far")
    learning.set_title("while learning")
    learning.set_ylim(bottom=-0.5)
    learning.legend(frameon=False)
    label_axes(trained, y="decisions for the barricaded lane, %")
    trained.set_title("the trained drivers")
    trained.set_xlim(-0.6, trained.get_xlim()[1] + 0.2)
    return figure


def _draw_learning(axes: "Axes", rows: Sequence[Row], color: str, label: str) -> None:
    """Draw the cumulative number of collisions with the barricade.

    A thin line is one training, the bold line is the mean.
    """
    seeds = grouped(rows, itemgetter("seed"))
    runs = [np.cumsum([row["hit"] == "barricade" for row in own]) for own in seeds.values()]
    episodes = np.arange(1, len(runs[0]) + 1)
    for run in runs:
        axes.plot(episodes, run, color=color, alpha=0.35, linewidth=1)
    axes.plot(episodes, np.mean(runs, axis=0), color=color, linewidth=2, label=label)


def _draw_trained(axes: "Axes", rows: Sequence[Row], bar: tuple[int, str, str]) -> None:
    """Draw the share of proposals to enter the closed lane: one dot per driver, a bar for the mean.

    ``bar`` is the bar's position, label and colour. The text below the bar says in how many
    episodes the ego hit something.
    """
    place, label, color = bar
    shares = [
        100
        * sum(int(row["barricade_proposals"]) for row in own)
        / sum(int(row["decisions"]) for row in own)
        for own in grouped(rows, itemgetter("seed")).values()
    ]
    hits = sum(row["hit"] not in ("", "by vehicle") for row in rows)
    axes.bar(place, float(np.mean(shares)), width=0.6, color=color, alpha=0.35)
    axes.plot([place] * len(shares), shares, "o", color=color)
    axes.set_xticks([*range(place + 1)])
    names = [name.get_text() for name in axes.get_xticklabels()][:place]
    axes.set_xticklabels([*names, f"{label}\nhit something in\n{hits} of {len(rows)} episodes"])


BARRICADE = Program(
    name="barricade",
    meaning="learning beside a closed lane, with the check and without",
    row="an episode of a training, or of the driver that it trained",
    plan=barricade_plan,
    derived={},
    tables={},
    figures={"barricade": barricade_figure},
)
