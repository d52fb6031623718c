"""The experiment ``barricade``: learning beside a closed lane, with and without the safety check.

It corresponds to Sec. II-C of the paper, "Need for safety". The same agent is trained with and
without the check, on a highway whose right lane is closed. Then the greedy policies are evaluated.
"""

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from operator import itemgetter
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
from drl_av.files import Row
from drl_av.road.road import Road
from drl_av.road.snapshot import CollisionKind
from studies.experiment import Experiment
from studies.options import ReproduceOptions
from studies.plan import Cell, Plan
from studies.store import MadeWith
from studies.values import require_numbers

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


@dataclass(frozen=True)
class BarricadeTraining(Cell):
    """A cell of the table: one training beside the closed lane, and its driver's evaluation.

    An interrupted training starts again from its beginning.
    """

    config: Config
    trained_episodes: int
    training: None = None
    """Always None: the cell trains in ``make``, without a TrainingJob."""

    @property
    def key(self) -> Row:
        """The columns and values that all rows of the cell have in common."""
        return {"safety_check": self.config.safety.check, "seed": str(self.config.learning.seed)}

    def missing(self, rows: Sequence[Row]) -> int:
        """Return the number of missing rows, either all or 0.

        Raises ValueError if only some of the rows exist.
        """
        driven = (self.config.learning.episodes, self.trained_episodes)
        places = [
            (phase, episode)
            for phase, count in zip(PHASES, driven, strict=True)
            for episode in range(1, count + 1)
        ]
        if rows and [(row["phase"], int(row["episode"])) for row in rows] != places:
            raise ValueError(f"{len(rows)} of {len(places)} rows of a training")
        return len(places) - len(rows)

    def make(self, rows: Sequence[Row], jobs: int) -> Generator[Row, None, None]:
        """Train a driver, then evaluate it; yield a row for each episode of both parts."""
        from drl_av.learning.training import build_training

        with closing(HighwayEnv(config=self.config)) as env:
            training = build_training(env)
            for episode in range(1, self.config.learning.episodes + 1):
                metrics = BarricadeMetrics(env.road)
                training.run_episode(metrics)
                yield self._row("training", episode, metrics)
            for seed in range(self.trained_episodes):
                metrics = BarricadeMetrics(env.road)
                for decision in rollout(env, training.driver, seed, TRAINED_VEHICLES):
                    metrics.add(decision)
                yield self._row("trained", seed + 1, metrics)

    def _row(self, phase: str, episode: int, metrics: BarricadeMetrics) -> Row:
        values = {"phase": phase, "episode": episode, "decisions": metrics.decisions}
        values |= {"barricade_proposals": metrics.barricade_proposals, "hit": metrics.hit}
        return self.key | {name: str(value) for name, value in values.items()}


def barricade_plan(options: ReproduceOptions) -> Plan:
    """Return a plan with one training of ``EPISODES`` episodes for each check and seed."""
    configs = [
        options.with_files(barricade_config(check, seed, EPISODES))
        .updated("simulation", scenario=SCENARIO)
        .updated("safety", check=check)
        .updated("learning", seed=seed)
        for seed in SEEDS
        for check in CHECKS
    ]
    cells = [BarricadeTraining(config, TRAINED_EPISODES) for config in configs]
    return Plan(MadeWith({"": configs[0]}, {"": None}), [cells], _place)


def _place(row: Row) -> tuple[int, int, int, int]:
    require_numbers(row, ("decisions", "barricade_proposals"))
    check, phase = CHECKS.index(row["safety_check"]), PHASES.index(row["phase"])
    return SEEDS.index(int(row["seed"])), check, phase, int(row["episode"])


def barricade_figure(rows: list[Row]) -> "Figure":
    """Draw two panels on the closed lane, each with and without the safety check.

    The left panel shows the collisions with the barricade in the trainings. The right panel shows
    how often the trained drivers propose to enter the closed lane.
    """
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


BARRICADE = Experiment(
    name="barricade",
    meaning="learning beside a closed lane, with the check and without",
    row="an episode of a training, or of the driver that it trained",
    plan=barricade_plan,
    figures={"barricade": barricade_figure},
)
