"""The barricaded lane: why the paper wants a safety check (Sec. "Need for safety").

The same agent is trained on the highway whose right lane is barricaded, with its check and
without, and every episode tells what it ended in. Then the trained agents drive, greedily.
"""

import csv
import io
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.driving.actions import ACTIONS
from drl_av.driving.maneuver import target_lane
from drl_av.env.highway import HighwayEnv, Observation
from drl_av.env.rollout import drive
from drl_av.files import write_whole
from drl_av.learning.training import Training
from drl_av.traffic.snapshot import CollisionKind

SCENARIO = "barricaded_right_lane"
CHECKS = ("permit_all", "paper")
SEEDS = (0, 1)
EPISODES = 120
TRAINED_EPISODES, TRAINED_VEHICLES = 20, 15


@dataclass(frozen=True)
class BarricadeRow:
    """A row of the table: an episode of a training, or of the driver that it trained."""

    safety_check: str
    seed: int
    """Of the training."""
    phase: str
    """``training`` explores, ``trained`` is the greedy driver afterwards, on seeds 0, 1, ..."""
    episode: int
    decisions: int
    barricade_proposals: int
    """Decisions for the barricaded lane, carried out or not."""
    hit: str
    """``barricade``, ``road edge``, ``vehicle``, ``by vehicle``, or empty without a collision."""


class Witness(HighwayEnv):
    """The environment, and what was seen of the episode so far."""

    def reset(self, **arguments: Any) -> tuple[Observation, dict[str, Any]]:
        """Start an episode, and count anew."""
        self.barricade_proposals, self.hit = 0, ""
        return super().reset(**arguments)

    def step(self, action: int | np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carry out one decision, and remember what it was for and what it hit."""
        before = self.scene
        self.barricade_proposals += self._barricaded(target_lane(before, ACTIONS[action].lateral))
        done = super().step(action)
        collision = done[4]["collision"]
        if collision is not None:
            executed = ACTIONS[done[4]["executed_action"]]
            barricaded = self._barricaded(target_lane(before, executed.lateral))
            edge = "barricade" if barricaded else "road edge"
            vehicle = "vehicle" if collision.kind.ego_hit else "by vehicle"
            self.hit = edge if collision.kind is CollisionKind.HIT_EDGE else vehicle
        return done

    def _barricaded(self, lane: int) -> bool:
        return 0 <= lane < len(self.road.open_lanes) and not self.road.is_open(lane)


def study_config(check: str, seed: int, episodes: int) -> Config:
    """The preset ``fast`` on that highway, with one network, from what happened, on the reward."""
    plain = {"networks": 1, "batch_size": 64, "learning_rate": 2e-3, "counterfactuals": 0}
    plain |= {"discount": 0.9, "speed_weight": 0.0, "unsafe_penalty": 0.0, "lane_change_margin": 0}
    fast = preset("fast").updated("learning", seed=seed, episodes=episodes, **plain)
    return fast.updated("simulation", scenario=SCENARIO).updated("safety", check=check)


def barricade_rows(config: Config, trained_episodes: int) -> Iterator[BarricadeRow]:
    """Train with the check of the config, a row an episode; then drive what was trained."""
    check, seed = config.safety.check, config.learning.seed
    with closing(Witness(config=config)) as env:
        training = Training(env)
        for episode in range(1, config.learning.episodes + 1):
            decisions = training.run_episode().decisions
            found = (env.barricade_proposals, env.hit)
            yield BarricadeRow(check, seed, "training", episode, decisions, *found)
        for episode in range(trained_episodes):
            decisions = drive(env, training.driver, check, episode, TRAINED_VEHICLES).decisions
            found = (env.barricade_proposals, env.hit)
            yield BarricadeRow(check, seed, "trained", episode + 1, decisions, *found)


def write_barricade_rows(path: Path, rows: Iterable[BarricadeRow]) -> None:
    """Write the CSV file whole or not at all; raises DrlAvError where the disk refuses."""
    text = io.StringIO(newline="")
    names = [field.name for field in fields(BarricadeRow)]
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    write_whole(path, text.getvalue().encode())
