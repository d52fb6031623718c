"""Algorithm 1, an episode at a time."""

from dataclasses import dataclass
from functools import partial
from itertools import cycle
from operator import index
from typing import Any

import numpy as np
import numpy.typing as npt

from drl_av.drivers.learned import learned_driver
from drl_av.drivers.network import QNetwork
from drl_av.drivers.policy_file import State
from drl_av.driving.actions import ACTIONS
from drl_av.driving.affordances import INDICATORS
from drl_av.driving.mirror import MIRROR
from drl_av.driving.scene import Scene
from drl_av.env.episode import TRAINING_SEEDS
from drl_av.env.highway import HighwayEnv
from drl_av.env.reward import speed_bonus
from drl_av.env.rollout import drive
from drl_av.learning.checkpoint import rng_from_json, rng_to_json
from drl_av.learning.counterfactuals import remember_others
from drl_av.learning.experience import make_buffer
from drl_av.learning.exploration import epsilon_greedy, linear_epsilon
from drl_av.learning.learner import Learner
from drl_av.learning.mirroring import mirror_half, require_symmetry

EVALUATION_SEEDS = 900_000
"""First traffic seed of the evaluations within training, which never trains on it."""


@dataclass(frozen=True)
class EpisodeRow:
    """A row of ``episodes.csv``."""

    episode: int
    seed: int
    vehicles: int
    decisions: int
    mean_reward: float
    mean_speed_m_s: float
    safety_triggers: int
    collided: bool
    ego_hit: bool
    epsilon: float
    mean_loss: float


@dataclass(frozen=True)
class EvaluationRow:
    """A row of ``evaluations.csv``: the greedy driver on the same seeded traffic every time."""

    episode: int
    mean_reward: float
    mean_r_v: float
    mean_r_y: float
    mean_r_x: float
    mean_speed_m_s: float
    collisions: int
    ego_hits: int
    safety_triggers: float


def learner_names(count: int) -> list[str]:
    """What the tensors of each learner begin with in a checkpoint."""
    return ["learner", *(f"learner{number}" for number in range(1, count))]


class Training:
    """Algorithm 1 at an episode boundary; all its randomness comes from ``learning.seed``.

    Raises:
        ConfigError: ``traffic.vehicles_max`` vehicles do not fit on the road; or the driver is
            to learn in a mirror where the reward is another one.
    """

    def __init__(self, env: HighwayEnv) -> None:
        env.require_room()
        require_symmetry(env.config, env.road)
        self._env = env
        self.config = env.config
        self._config = env.config.learning
        self._rng = np.random.default_rng(self._config.seed)
        hidden = (self._config.hidden_units,) * 2
        self.networks = [
            QNetwork(self._rng, len(INDICATORS), len(ACTIONS), hidden)
            for _ in range(self._config.networks)
        ]
        self.driver = learned_driver(self.networks, self._config)
        self._learners = {
            name: Learner(network, self._config.learning_rate)
            for name, network in zip(learner_names(len(self.networks)), self.networks, strict=True)
        }
        self._buffer = make_buffer(self._config, len(INDICATORS))
        self.episodes_done = 0

    @property
    def epsilon(self) -> float:
        """Exploration in the coming episode."""
        config = self._config
        return linear_epsilon(
            self.episodes_done,
            config.episodes,
            config.epsilon_start,
            config.epsilon_end,
            config.epsilon_fraction,
        )

    @property
    def learning_rate(self) -> float:
        """Adam's step size in the coming episode."""
        lost = 1 - self._config.learning_rate_end_fraction
        return self._config.learning_rate * (1 - lost * self.episodes_done / self._config.episodes)

    def run_episode(self) -> EpisodeRow:
        """Lines 3 to 17: one episode, learning after each decision."""
        epsilon = self.epsilon
        for learner in self._learners.values():
            learner.learning_rate = self.learning_rate
        self._buffer.anneal(self.episodes_done / self._config.episodes)
        seed = self._traffic_seed()
        gradient_steps = self._config.gradient_steps if self._learns else 0
        turns = self._config.networks_take_turns
        each = list(self._learners.values())
        learners = cycle([[learner] for learner in each] if turns else [each])
        s_t, info = self._env.reset(seed=seed)
        rewards, speeds, losses, triggers, over = [], [], [], 0, False
        while not over:
            before = self._env.scene
            greedy = partial(self.driver.greedy, s_t)
            a_t = epsilon_greedy(epsilon, len(ACTIONS), greedy, self._rng)
            s_tp1, r_tp1, terminated, truncated, info = self._env.step(a_t)
            self._remember(s_t, a_t, r_tp1, s_tp1, terminated, info)
            if self._config.counterfactuals and not terminated:
                self._remember_others(before, s_t, a_t, info["executed_action"])
            for _ in range(gradient_steps):
                losses += [self._learn(learner) for learner in next(learners)]
            rewards.append(r_tp1)
            speeds.append(info["speed_m_s"])
            triggers += info["rule"] != "none"
            s_t, over = s_tp1, terminated or truncated
        self.episodes_done += 1
        if self.episodes_done % self._config.target_update_episodes == 0:
            for learner in self._learners.values():
                learner.sync_target()
        collision = info["collision"]
        return EpisodeRow(
            episode=self.episodes_done,
            seed=seed,
            vehicles=info["vehicles"],
            decisions=len(rewards),
            mean_reward=float(np.mean(rewards)),
            mean_speed_m_s=float(np.mean(speeds)),
            safety_triggers=triggers,
            collided=collision is not None,
            ego_hit=collision is not None and collision.kind.ego_hit,
            epsilon=epsilon,
            mean_loss=float(np.mean(losses)) if losses else 0.0,
        )

    def evaluate(self) -> EvaluationRow:
        """The greedy driver on fixed traffic, from the fewest vehicles to the most."""
        traffic, count = self._env.config.traffic, self._config.evaluation_episodes
        placed = self._env.simulation.placed_vehicles
        numbers = np.linspace(traffic.vehicles_min, traffic.vehicles_max, count).round()
        if placed is not None:
            numbers[:] = placed
        results = [
            drive(self._env, self.driver, "ddqn", EVALUATION_SEEDS + i, int(vehicles))
            for i, vehicles in enumerate(numbers)
        ]

        def mean(name: str) -> float:
            return float(np.mean([getattr(result, name) for result in results]))

        return EvaluationRow(
            episode=self.episodes_done,
            mean_reward=mean("mean_reward"),
            mean_r_v=mean("mean_r_v"),
            mean_r_y=mean("mean_r_y"),
            mean_r_x=mean("mean_r_x"),
            mean_speed_m_s=mean("mean_speed_m_s"),
            collisions=sum(result.collided for result in results),
            ego_hits=sum(result.ego_hit for result in results),
            safety_triggers=mean("safety_triggers"),
        )

    def state(self) -> tuple[State, dict[str, Any]]:
        """Tensors and numbers that the rest of the training depends on."""
        parts = {name: learner.state() for name, learner in self._learners.items()}
        parts["buffer"] = self._buffer.state()
        tensors = {f"{part}.{k}": v for part, state in parts.items() for k, v in state.items()}
        return tensors, {"episodes_done": self.episodes_done, "rng": rng_to_json(self._rng)}

    def restore(self, tensors: State, numbers: dict[str, Any]) -> None:
        """Go on from ``state`` exactly; raises CheckpointError where it does not fit."""
        for name, learner in self._learners.items():
            learner.restore(_part(tensors, f"{name}."))
        self._buffer.restore(_part(tensors, "buffer."))
        self._rng = rng_from_json(numbers["rng"])
        self.episodes_done = index(numbers["episodes_done"])

    @property
    def _learns(self) -> bool:
        """Whether the coming episode is learnt in."""
        known = self._buffer.collisions >= self._config.collisions_to_start
        return known and self._config.learning_rate > 0

    def _traffic_seed(self) -> int:
        """Line 3: the coming episode's; from a generator of its own where learning is compared."""
        own = [self._config.seed, self.episodes_done + 1]
        rng = np.random.default_rng(own) if self._config.traffic_by_episode else self._rng
        return int(rng.integers(*TRAINING_SEEDS))

    def _remember(
        self,
        s_t: npt.NDArray[np.float32],
        a_t: int,
        r_tp1: float,
        s_tp1: npt.NDArray[np.float32],
        terminated: bool,
        info: dict[str, Any],
    ) -> None:
        """Lines 6 and 8 to 12: an unsafe proposal and a collision into Buf_C, the rest in Buf_S.

        Ours, where the settings ask for it: speed beside the reward, and an unsafe proposal that
        goes on as what was executed in its place, less a penalty.
        """
        config, learning = self._env.config, self._config
        r_col = config.reward.collision_reward
        learnt = r_tp1 + speed_bonus(info["speed_m_s"], config.ego, learning.speed_weight)
        if info["rule"] != "none":
            if learning.unsafe_penalty and not terminated:
                self._buffer.add_unsafe(s_t, a_t, learnt - learning.unsafe_penalty, s_tp1)
            else:
                self._buffer.add_collision(s_t, a_t, r_col)
        if terminated:
            self._buffer.add_collision(s_t, info["executed_action"], r_col)
        else:
            self._buffer.add_safe(s_t, info["executed_action"], learnt, s_tp1)

    def _remember_others(
        self, before: Scene, s_t: npt.NDArray[np.float32], a_t: int, executed: int
    ) -> None:
        """What some of the actions neither proposed nor executed would have led to."""
        drawn = self._rng.choice(len(ACTIONS), self._config.counterfactuals, replace=False)
        others = [ACTIONS[number] for number in drawn if number not in (a_t, executed)]
        remember_others(self._buffer, self._env, before, s_t, ACTIONS[executed], others)

    def _learn(self, learner: Learner) -> float:
        """Lines 13 to 15."""
        batch = self._buffer.sample(self._config.batch_size, self._rng)
        loss = learner.update(mirror_half(batch, MIRROR) if self._config.mirrored else batch)
        self._buffer.learned_from(batch, learner.td_errors)
        return loss


def _part(tensors: State, prefix: str) -> State:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
