"""Algorithm 1 of the paper: trains a driver, episode by episode."""

from collections.abc import Callable
from dataclasses import dataclass
from operator import index
from typing import Any

import numpy as np

from drl_av.arrays import Float32Array
from drl_av.config import Config, LearningConfig
from drl_av.drivers.driver import Driver
from drl_av.drivers.learned import learned_driver
from drl_av.drivers.network import QNetwork
from drl_av.drivers.policy_file import State
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.affordances import observed_indicators
from drl_av.driving.mirror import Mirror, mirror_of, mirrored_observations
from drl_av.driving.scene import Scene
from drl_av.env.episode_start import traffic_seed
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics
from drl_av.env.rollout import drive, rollout
from drl_av.env.transition import Transition
from drl_av.errors import CheckpointError, ConfigError
from drl_av.learning.learner import Learner
from drl_av.learning.prioritized import PrioritizedBuffer
from drl_av.learning.replay import Batch, Buffer, TwoBuffers, UniformBuffer, part_of, require_memory
from drl_av.road.road import Road

EVALUATION_SEEDS = 900_000
"""First traffic seed of the evaluations during training; training episodes never use it."""


@dataclass(frozen=True)
class EpisodeRow:
    """A row of ``episodes.csv``: one training episode.

    The means are over its decisions, ``mean_loss`` over its gradient steps (0 without any).
    ``ego_hit`` is true if the ego hit something, false if it was hit or did not collide.
    """

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
    """A row of ``evaluations.csv``: the greedy driver in a fixed set of evaluation episodes.

    ``collisions`` and ``ego_hits`` are numbers of episodes; all other results are means over the
    episodes.
    """

    episode: int
    mean_reward: float
    mean_r_v: float
    mean_r_y: float
    mean_r_x: float
    mean_speed_m_s: float
    collisions: int
    ego_hits: int
    safety_triggers: float


def linear_epsilon(episode: int, config: LearningConfig) -> float:
    """Return epsilon, the probability of a random action, in an episode; the first episode is 0.

    Epsilon decreases linearly from ``epsilon_start`` to ``epsilon_end`` over the first
    ``epsilon_fraction`` of all ``episodes``, and is constant afterwards (Sec. IV-C of the paper).
    """
    progress = min(1.0, episode / (config.epsilon_fraction * config.episodes))
    return (1.0 - progress) * config.epsilon_start + progress * config.epsilon_end


class ExploringDriver(Driver):
    """Adds epsilon-greedy exploration to a driver; set ``epsilon`` before each episode.

    The random numbers come from the training's generator, not from the episode's seed.
    """

    def __init__(self, driver: Driver, rng: np.random.Generator) -> None:
        self._driver, self._rng = driver, rng
        self.epsilon = 1.0

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return a random action with probability ``epsilon``, else the driver's greedy action."""
        if self._rng.random() < self.epsilon:
            return ACTIONS[self._rng.integers(len(ACTIONS))]
        return self._driver.act(scene, observation)


def store(decision: Transition, buffer: Buffer, r_col: float) -> None:
    """Store a decision as experience: Algorithm 1 of the paper, lines 6 and 8 to 12.

    Buf_C receives each proposal that the check replaced, with reward ``r_col``, and each executed
    action that led to a collision, with the decision's, both as terminal transitions. Buf_S
    receives all other executed actions. A missed exit counts as a replaced proposal (ours).
    """
    s_t, executed = decision.observation, decision.executed.number
    if decision.triggered:
        buffer.add_collision(s_t, decision.proposed.number, r_col)  # line 6
    if decision.failed:
        reward = decision.reward if decision.terminated else r_col
        buffer.add_collision(s_t, executed, reward)  # line 9
    else:
        buffer.add_safe(s_t, executed, decision.reward, decision.next_observation)  # line 11


def mirror_half(batch: Batch, mirror: Mirror) -> Batch:
    """Exchange left and right in every second transition of a minibatch, in place; return it.

    The rows of the safe buffer precede those of the collision buffer, so half of each is mirrored.
    The rewards stay as they are, because the reward is symmetric.
    """
    for s in (batch.s_t, batch.s_tp1):
        s[::2] = mirrored_observations(s[::2], mirror)
    batch.a_t[::2] = mirror.action_permutation[batch.a_t[::2]]
    return batch


class Training:
    """A training by Algorithm 1 of the paper, which can be saved and restored between episodes.

    Args:
        env: The environment; its config holds the schedules.
        driver: The greedy driver of the learner's network. A training episode adds exploration, an
            evaluation does not.
        learner: Makes the gradient steps.
        buffer: The experience buffer, which the decisions fill and the learner samples.
        rng: The source of all random numbers.
    """

    def __init__(
        self,
        env: HighwayEnv,
        driver: Driver,
        learner: Learner,
        buffer: Buffer,
        rng: np.random.Generator,
    ) -> None:
        self.config, self.driver = env.config, driver
        self._env, self._config = env, env.config.learning
        self._learner, self._buffer, self._rng = learner, buffer, rng
        self._explorer = ExploringDriver(driver, rng)
        self._mirror = mirror_of(observed_indicators(env.config.observation))
        self.episodes_done = 0

    @property
    def learning_rate(self) -> float:
        """Step size of Adam in the next episode."""
        lost = 1 - self._config.learning_rate_end_fraction
        return self._config.learning_rate * (1 - lost * self.episodes_done / self._config.episodes)

    def run_episode(self, metrics: EpisodeMetrics | None = None) -> EpisodeRow:
        """Drive one training episode, learn after each decision, and return the episode's row.

        Algorithm 1 of the paper, lines 3 to 17.

        Args:
            metrics: An empty EpisodeMetrics to fill, if the caller needs more than the row.
        """
        metrics = metrics or EpisodeMetrics()
        self._explorer.epsilon = epsilon = linear_epsilon(self.episodes_done, self._config)
        self._learner.learning_rate = self.learning_rate
        self._buffer.anneal(self.episodes_done / self._config.episodes)
        seed, vehicles = traffic_seed(None, {}, self._rng), 0
        gradient_steps, losses = self._gradient_steps, list[float]()
        for decision in rollout(self._env, self._explorer, seed, self._draw_vehicles(seed)):
            if not metrics.decisions:
                vehicles = len(decision.scene.snapshot.ids) - 1
            store(decision, self._buffer, self.config.reward.collision_reward)
            losses += [self._learn() for _ in range(gradient_steps)]
            metrics.add(decision)
        self.episodes_done += 1
        if self.episodes_done % self._config.target_update_episodes == 0:
            self._learner.sync_target()
        return EpisodeRow(
            episode=self.episodes_done,
            seed=seed,
            vehicles=vehicles,
            decisions=metrics.decisions,
            mean_reward=float(np.mean(metrics.rewards)),
            mean_speed_m_s=float(np.mean(metrics.speeds_m_s)),
            safety_triggers=metrics.safety_triggers,
            collided=metrics.collided,
            ego_hit=metrics.ego_hit,
            epsilon=epsilon,
            mean_loss=float(np.mean(losses)) if losses else 0.0,
        )

    def _draw_vehicles(self, seed: int) -> int | None:
        """Draw the number of other vehicles at the start of an episode; None: its seed decides."""
        most = self._env.fleet_of(seed).most_in_training
        return None if most is None else int(self._rng.integers(most + 1))

    @property
    def _gradient_steps(self) -> int:
        """Number of gradient steps after each decision of the next episode.

        It is 0 if too few collisions are stored at its beginning.
        """
        enough = self._buffer.collisions >= self._config.collisions_to_start
        return self._config.gradient_steps if enough and self._config.learning_rate > 0 else 0

    def _learn(self) -> float:
        """Make a gradient step on a batch (Algorithm 1, lines 13 to 15); return the loss."""
        batch = self._buffer.sample(self._config.batch_size, self._rng)
        if self._config.mirrored:
            mirror_half(batch, self._mirror)
        update = self._learner.update(batch)
        self._buffer.update_priorities(batch, update.td_errors)
        return update.loss

    def evaluate(self) -> EvaluationRow:
        """Drive the evaluation episodes with the greedy driver, and return their row.

        The traffic is the same in each evaluation. The numbers of vehicles are evenly spaced from
        the smallest to the largest number in a training among this kind of traffic.
        """
        results = [
            drive(self._env, self.driver, "ddqn", EVALUATION_SEEDS + i, self._vehicles_of(i))
            for i in range(self._config.evaluation_episodes)
        ]
        names = (
            *("mean_reward", "mean_r_v", "mean_r_y", "mean_r_x"),
            *("mean_speed_m_s", "safety_triggers"),
        )
        means = {name: float(np.mean([getattr(each, name) for each in results])) for name in names}
        return EvaluationRow(
            episode=self.episodes_done,
            collisions=sum(result.collided for result in results),
            ego_hits=sum(result.ego_hit for result in results),
            **means,
        )

    def _vehicles_of(self, evaluation_episode: int) -> int:
        """Return the number of other vehicles in an episode of an evaluation."""
        fleet = self._env.fleet_of(EVALUATION_SEEDS + evaluation_episode)
        traffic, most = self.config.traffic, fleet.most_in_training
        ends = (traffic.vehicles_min, traffic.vehicles_max) if most is None else (0, most)
        if (placed := fleet.placed) is not None:
            ends = placed, placed
        episodes = self._config.evaluation_episodes
        numbers = np.linspace(*ends, episodes) if episodes > 1 else np.mean([ends], axis=1)
        return int(numbers.round()[evaluation_episode])

    @property
    def network(self) -> QNetwork:
        """The learner's online network."""
        return self._learner.network

    def state(self) -> tuple[State, dict[str, Any]]:
        """Return the tensors, by name, and the numbers that determine the rest of the training."""
        parts = {"learner": self._learner.state(), "buffer": self._buffer.state()}
        tensors = {f"{part}.{k}": v for part, state in parts.items() for k, v in state.items()}
        return tensors, {
            "episodes_done": self.episodes_done,
            "rng": dict(self._rng.bit_generator.state),
        }

    def restore(self, tensors: State, numbers: dict[str, Any]) -> None:
        """Restore exactly the result of ``state``.

        Raises:
            CheckpointError: the tensors do not fit the learner or the buffer of these settings;
                the training must not go on.
            LookupError, TypeError, ArithmeticError, ValueError: the numbers are none of a training.
        """
        try:
            self._learner.restore(part_of(tensors, "learner."))
            self._buffer.restore(part_of(tensors, "buffer."))
        except (LookupError, TypeError, ValueError) as error:
            raise CheckpointError(
                "The stored training does not fit learning.hidden_units, learning.replay or the "
                f"capacities ({error}): continue with those that it was begun with."
            ) from error
        self._rng.bit_generator.state = numbers["rng"]
        self.episodes_done = index(numbers["episodes_done"])


def require_symmetry(config: Config, road: Road) -> None:
    """Raise ConfigError if ``learning.mirrored`` is set, but the reward is not symmetric.

    The reward is symmetric if exchanging left and right does not change it. It is not symmetric if
    y_des is fixed at another position than the middle of the road.
    """
    middle_m = road.center_m(len(road.open_lanes) - 1) / 2
    fixed = config.learning.mirrored and config.reward.desired == "fixed"
    if fixed and config.reward.desired_lateral_m != middle_m:
        raise ConfigError(
            f"reward.desired_lateral_m = {config.reward.desired_lateral_m:g} is not the middle of "
            f"the road, {middle_m:g} m: learn there with learning.mirrored = false."
        )


def build_training(env: HighwayEnv) -> Training:
    """Build a new training by Algorithm 1 of the paper, with the settings of ``env.config``.

    All its random numbers come from one generator, seeded with ``learning.seed``.

    Raises:
        ConfigError: ``traffic.vehicles_max`` vehicles do not fit on the road; the experience buffer
            does not fit in the memory; or ``learning.mirrored`` is set, but the reward of a scene
            and of its mirror image differ. Nothing tells whether a reward of the user does.
    """
    env.require_room()
    require_symmetry(env.config, env.road)
    config, size = env.config.learning, len(observed_indicators(env.config.observation))
    rng = np.random.default_rng(config.seed)
    learner = Learner(QNetwork(rng, size, hidden=(config.hidden_units,) * 2), config.learning_rate)
    driver = learned_driver(learner.network, env.config)
    return Training(env, driver, learner, make_buffer(config, size), rng)


def make_buffer(config: LearningConfig, observation_size: int) -> Buffer:
    """Make an empty experience buffer of the kind ``config.replay``.

    Raises:
        ConfigError: the available memory is too small for the full buffer, or learning would never
            start.
    """
    is_one = config.replay != "two-buffer"
    most = config.collision_capacity + is_one * config.safe_capacity
    if config.collisions_to_start > most:
        raise ConfigError(
            f"learning.collisions_to_start is {config.collisions_to_start}, but the buffer of "
            f"collisions holds {most}, so nothing would be learned: set it to {most} or less."
        )
    if is_one and np.float32(config.discount) == 0:
        raise ConfigError(
            "With learning.discount = 0 each transition would count as a collision in one buffer: "
            "set it above 0, or learning.replay to two-buffer."
        )
    require_memory(config.safe_capacity + config.collision_capacity, observation_size)
    return BUFFERS[config.replay](observation_size, config)


BUFFERS: dict[str, Callable[[int, LearningConfig], Buffer]] = {
    "two-buffer": TwoBuffers,
    "prioritized": PrioritizedBuffer,
    "uniform": UniformBuffer,
}
"""The experience buffer of each kind ``learning.replay``."""
