"""``gymnasium.make_vec("drl_av/Highway-v0", ...)``: many highways at once, in the compiled twin."""

from collections.abc import Iterable, Mapping, Sequence
from copy import copy, deepcopy
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array, iterate

from drl_av.arrays import BoolArray, FloatArray, IntArray
from drl_av.config import Config
from drl_av.config.section import not_one_of
from drl_av.driving.actions import ACTIONS
from drl_av.driving.observation_scale import ObservationScale
from drl_av.driving.scene import Scene
from drl_av.driving.wide_observation import WIDE_SIZE
from drl_av.env.custom import custom_observation_of, custom_reward_of
from drl_av.env.episode_start import (
    actions_of_worlds,
    most_decisions,
    number_of_vehicles,
    require_numbers,
    require_range,
    reset_options,
    rows_to_reset,
    seeds_of_worlds,
    settings_on,
    traffic_seed,
)
from drl_av.env.observation import (
    GroupObservation,
    ObservationFunction,
    WideObservation,
    default_groups,
    observation_function,
)
from drl_av.env.transition import RewardFunction, RouteOutcome, custom_reward
from drl_av.env.twin_episodes import CHECK_NUMBERS, look_all
from drl_av.env.vector_info import common_info, marked, step_info, transition_of, with_final
from drl_av.env.wide_view import wide_view
from drl_av.env.world_arrays import Begun, WorldArrays
from drl_av.errors import ConfigError
from drl_av.random_streams import kind_of_traffic
from drl_av.road.sweep import NO_CONTACT
from drl_av.safety import named_check
from drl_av.safety.strict import Strict
from drl_av.twin.traffic import draw_future
from drl_av.twin.worlds import LANE, MODEL

FIRST_EVENTS = 64
"""Random events of an episode for which there is room before the arrays grow."""
Observations = Any
"""By default float32 of shape (worlds, 27), otherwise what gymnasium batches of the space."""


class TwinVectorEnv(WorldArrays, VectorEnv[Observations, IntArray, npt.NDArray[Any]]):
    """Many highways at once, in the compiled twin of SUMO's traffic (``drl_av.twin``).

    It has the observation, the actions, the reward, the safety checks and the ``info`` of
    ``drl_av/Highway-v0``, with one entry a world. The world ``i`` of ``reset(seed=s)`` has the seed
    ``s + i``, and a traffic seed means the same episode as in SUMO: the same vehicles with the same
    parameters, which request the same lane changes.

    Args:
        num_envs: The number of worlds.
        scenario: A scenario folder, or the name of a shipped scenario.
        safety_check: The name of a check.
        config: Settings, as for ``drl_av/Highway-v0``.
        observation: Names of groups of indicators or an object, as for ``drl_av/Highway-v0``; an
            object is called for each world.
        reward: A function, as for ``drl_av/Highway-v0``, that is called for each world.
        action_mask: Whether ``info`` holds the action masks, shape (num_envs, 12), int8.
        autoreset_mode: When an episode that is over begins again: at the next step, as gymnasium's
            vector environments do by default, in the same step, or not at all.
        threads: Threads among which the worlds are divided; the results do not depend on it.
        max_episode_steps: The most decisions in an episode; by default as in the environment.
        render_mode: None; the twin draws no pictures.
        sumo_options: None; the twin has no SUMO.

    Raises:
        ConfigError: a setting is wrong, or the twin cannot do what the settings ask.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Path | None = None,
        safety_check: str | None = None,
        config: Config | Mapping[str, Any] | str | Path | None = None,
        action_mask: bool = True,
        observation: str | Iterable[str] | ObservationFunction | None = None,
        reward: str | RewardFunction | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        max_episode_steps: int | None = None,
        render_mode: None = None,
        sumo_options: None = None,
    ) -> None:
        if render_mode is not None or sumo_options:
            raise ConfigError(
                "make_vec drives in the twin, which has no pictures and no SUMO: leave render_mode "
                "and sumo_options out, or add vectorization_mode='sync'."
            )
        named = config.get("simulation") if isinstance(config, Mapping) else None
        if isinstance(named, Mapping) and named.get("world") == "sumo":
            raise ConfigError(
                "make_vec drives in the twin, but simulation.world is sumo: leave it out, or add "
                "vectorization_mode='sync'."
            )
        config = settings_on(config, scenario).updated("simulation", world="twin")
        if safety_check is not None:
            if not isinstance(safety_check, str):
                raise ConfigError(
                    f"safety_check is {safety_check!r}, but the twin has the named checks only "
                    f"({', '.join(CHECK_NUMBERS)}): name one, or add vectorization_mode='sync'."
                )
            config = config.updated("safety", check=safety_check)
        WorldArrays.__init__(self, config)
        self._check = named_check(config, self._scenario.vehicle_types, self.road)
        scale = ObservationScale(config.observation, config.ego.max_speed_m_s, self.road)
        groups = default_groups(config.observation) if observation is None else observation
        self._observe = observation_function(custom_observation_of(groups), scale)
        self._reward = None if reward is None else custom_reward_of(reward)
        self.single_observation_space = self._observe.space
        self.single_action_space = gymnasium.spaces.Discrete(len(ACTIONS))
        require_numbers(num_envs=(num_envs, 1, None), threads=(threads, 1, None))
        self._masked, self._threads = action_mask, threads
        self._is_fork = self._begun = False
        self.most_decisions = most_decisions(config, self._scenario.layout)
        self._limit = self.most_decisions if max_episode_steps is None else max_episode_steps
        require_numbers(max_episode_steps=(self._limit, 1, None))
        if autoreset_mode not in (*AutoresetMode, *(modes := [m.value for m in AutoresetMode])):
            raise ConfigError(not_one_of("autoreset_mode", autoreset_mode, modes))
        self._make_episodes(num_envs, AutoresetMode(autoreset_mode))
        self._make_arrays(config.traffic.vehicles_max + 1, FIRST_EVENTS)

    @cached_property
    def observation_space(self) -> gymnasium.Space[Any]:  # type: ignore[override]
        """The space of the observations of all worlds."""
        return batch_space(self.single_observation_space, self.num_envs)

    @cached_property
    def action_space(self) -> gymnasium.Space[Any]:  # type: ignore[override]
        """The space of the actions of all worlds."""
        return batch_space(self.single_action_space, self.num_envs)

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """The seed of each world's sequence of episodes, as in gymnasium's vector environments."""
        bits: list[Any] = [one and one.bit_generator for one in self._generators]
        return tuple(one and one.seed_seq.entropy for one in bits)

    def _make_episodes(self, count: int, mode: AutoresetMode) -> None:
        """Make so many worlds, in which no episode has begun."""
        self._make_worlds(count, self._threads)
        self.autoreset_mode = mode
        self.metadata = {"render_modes": [], "autoreset_mode": mode}
        self._generators: list[np.random.Generator | None] = [None] * count
        self._over = np.ones(count, np.bool_)
        self._rows = np.arange(count)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, dict[str, Any]]:
        """Start an episode in each world; the arguments are those of ``drl_av/Highway-v0``.

        ``options`` may also hold ``reset_mask``, the worlds to reset, bool of shape (num_envs,).

        Raises:
            ConfigError: an option is wrong, or there are not as many seeds as worlds.
            ScenarioError: the vehicles do not fit on the road.
        """
        given = reset_options(options, "reset_mask")
        rows = rows_to_reset(given.pop("reset_mask", None), self.num_envs, self._begun)
        self._begin(rows, seeds_of_worlds(seed, self.num_envs), given)
        self._begun = True
        return self._observations(), self._info() | self._start_info(rows)

    def step(
        self, actions: IntArray
    ) -> tuple[
        Observations,
        FloatArray,
        BoolArray,
        BoolArray,
        dict[str, Any],
    ]:
        """Execute one decision in each world, shape (num_envs,); see ``autoreset_mode``.

        Raises:
            ConfigError: the actions are not one number from 0 to 11 for each world.
            gymnasium.error.ResetNeeded: no episode has begun, or one is over that is not reset by
                itself.
        """
        if not self._begun:
            raise gymnasium.error.ResetNeeded("There is no episode to drive on in: call reset.")
        proposed = actions_of_worlds(actions, self.num_envs)
        begins = self._over.copy()
        if begins.any() and not self._is_fork:
            if self.autoreset_mode == AutoresetMode.DISABLED:
                raise gymnasium.error.ResetNeeded(
                    "An episode is over: call reset with the option reset_mask."
                )
            self._begin(np.flatnonzero(begins))
        rows = np.flatnonzero(~begins)
        before = None if self._reward is None else self._seen()
        self._begun = False  # until the decision is complete: a function of the user may raise
        executed = self.episodes.executed[self._rows, proposed]
        rules = self.episodes.rules[self._rows, proposed]
        self._decide(rows, proposed)
        goes_on = ~begins | self._is_fork
        terminated = (self.episodes.collision[:, 0] != NO_CONTACT) & goes_on
        late = self.episodes.decisions >= self.most_decisions
        complete = (late | (self.episodes.scene[:, 0, 0] >= self.road.end_m)) & goes_on
        ends = terminated | complete
        truncated = complete | ((self.episodes.decisions >= self._limit) & goes_on)
        r_v, r_y, r_x = self.episodes.terms.T
        rewards = (r_v + r_y + r_x) / 3
        rewards[terminated] = self.config.reward.collision_reward
        rewards[begins] = 0.0
        self._over = terminated | truncated
        if not self.road.is_loop:
            for row in rows.tolist():
                self.ways[row] = self.routes[row].outcome(self._indicators(row), bool(ends[row]))
        info = self._info()
        decided = proposed, executed, rules
        info |= step_info(self, ends, decided, ~begins)
        if not goes_on.all():
            info |= self._start_info(np.flatnonzero(begins))
        observations = self._observations()
        if self._reward is not None and before is not None:
            now, outcome = self._seen(), (rewards, terminated, complete)
            for row in rows.tolist():
                made = transition_of(self, row, (before[row], now[row]), decided, outcome)
                rewards[row] = custom_reward(self._reward, made)
        self._begun = True
        if self.autoreset_mode == AutoresetMode.SAME_STEP and self._over.any():
            observations = self._restart(observations, info)
        return observations, rewards, terminated, truncated, info

    def fork(
        self, n: int, seed: int = 0, include_rng: bool = False, world: int = 0
    ) -> "TwinVectorEnv":
        """Return ``n`` copies of a world's episode, each of which goes on by itself, for search.

        An episode that is over stays as it is, with reward 0. Copies can be forked in turn.

        Args:
            n: The number of copies.
            seed: The other vehicles of the copy i behave at random by the seed ``seed`` + i.
            include_rng: Whether they behave as they will in the original instead, so that a
                search is clairvoyant; so named after ``clone_state`` of the Arcade Learning
                Environment.
            world: The world to copy.

        Raises:
            gymnasium.error.ResetNeeded: the episode is over, or none has begun.
            ConfigError: ``n``, ``seed`` or ``world`` is not a possible number.
        """
        require_numbers(n=(n, 1, None), seed=(seed, 0, None), world=(world, 0, self.num_envs))
        if self._over[world] or not self._begun:
            raise gymnasium.error.ResetNeeded("There is no episode to fork: call reset.")
        fork, decisions = copy(self), int(self.episodes.decisions[world])
        for space in ("observation_space", "action_space"):
            vars(fork).pop(space, None)  # those of other worlds, which take long to make
        fork._is_fork = True
        fork._make_episodes(n, AutoresetMode.DISABLED)
        fork._make_arrays(self.worlds.x.shape[2], self.episodes.events.shape[1])
        given: tuple[Any, ...] = (*self.worlds, *self.episodes)
        made: tuple[Any, ...] = (*fork.worlds, *fork.episodes)
        for before, after in zip(given, made, strict=True):
            after[:] = before[world]
        fork.seeds[:], fork.vehicles[:] = self.seeds[world], self.vehicles[world]
        fork._over[:], fork.ways[:] = False, self.ways[world]
        if not self.road.is_loop:
            fork._take_traffic(self, world, None if include_rng else seed)
        elif not include_rng:
            kinds, timing = self.config.per_traffic_preset, self.config.simulation
            kind = kind_of_traffic(int(self.seeds[world]), kinds)
            models = self.worlds.z[world, MODEL, : self.vehicles[world] + 1]
            left = models, kind, decisions, timing.decisions_per_episode - decisions
            for row in range(n):
                fork._set_events(row, draw_future(seed + row, *left))
        if self._reward is not None:
            fork._observations()
        return fork

    def action_masks(self) -> npt.NDArray[np.int8]:
        """Return the action masks of the present scenes, shape (num_envs, 12), int8.

        Raises gymnasium.error.ResetNeeded if no episode has begun.
        """
        if not self._begun:
            raise gymnasium.error.ResetNeeded("There are no scenes yet: call reset.")
        return self._masks()

    def _masks(self) -> npt.NDArray[np.int8]:
        masks: npt.NDArray[np.int8] = (self.episodes.executed == np.arange(12)).astype(np.int8)
        return masks

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads and the episodes."""
        self._begun = False
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def _observations(self) -> Observations:
        """Return the present observations; the records of decisions hold a copy of them."""
        seen = self._look()
        self._observed = seen if self._reward is None else deepcopy(seen)
        return seen

    def _look(self) -> Observations:
        if isinstance(self._observe, WideObservation):
            return wide_view(self)[0][:, :WIDE_SIZE].copy()
        if not isinstance(self._observe, GroupObservation):
            space = self.single_observation_space
            each = [self._observe(self.scene(row)) for row in range(self.num_envs)]
            room: Any = create_empty_array(space, self.num_envs)
            return concatenate(space, each, room)
        episodes, (origin, target) = self.episodes, self.episodes.lanes.T
        seen = episodes.observation, episodes.values, episodes.codes
        return self._observe.of_worlds(*seen, target - origin, self.task.road.barriers)

    def _restart(self, last: Observations, info: dict[str, Any]) -> Observations:
        """Reset the worlds whose episode is over; their last scene goes to ``info``."""
        over = self._over.copy()
        info |= with_final(info, iterate(self.observation_space, last), over)
        rows = np.flatnonzero(over)
        self._begin(rows)
        info |= self._info() | self._start_info(rows)
        return self._observations()

    def _seen(self) -> list[tuple[Scene, Any]]:
        """Return the present scene of each world, with its observation."""
        each = iterate(self.observation_space, self._observed)
        return [*zip(map(self.scene, range(self.num_envs)), each, strict=True)]

    def _begin(
        self,
        rows: npt.NDArray[np.intp],
        seeds: Sequence[int | None] = (),
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Start an episode in each of the worlds ``rows``, or in none if one of them is refused."""
        given = options or {}
        if "vehicles" not in given:
            require_range(self._fleets)
        begun = [self._drawn(row, seeds[row] if seeds else None, given) for row in rows.tolist()]
        self.make_room(max((len(one.fleet.ids) for one in begun), default=0), 0)
        for row, one in zip(rows.tolist(), begun, strict=True):
            self._generators[row], self.seeds[row] = one.generator, one.seed
            self._place(row, one)
        episodes = self.episodes
        episodes.lanes[rows] = self.worlds.z[rows, LANE, :1]
        episodes.heading_rad[rows], episodes.decisions[rows], episodes.sums[rows] = 0.0, 0, 0.0
        episodes.collision[rows] = NO_CONTACT, 0
        self._over[rows], self.collided_with[rows] = False, ""
        look_all(self.worlds, self.episodes, self.task, rows.astype(np.int64))
        if not self.road.is_loop:
            for row in rows.tolist():
                self.routes[row] = RouteOutcome(self.road, self._indicators(row))
        self.ways[rows] = ""

    def _drawn(self, row: int, seed: int | None, options: Mapping[str, Any]) -> Begun:
        """Draw the next episode of a world."""
        generator = self._generators[row]
        if generator is None or seed is not None:
            generator, _ = seeding.np_random(seed)
        seed = traffic_seed(seed, options, generator)
        vehicles = number_of_vehicles(options, seed, self.fleet_of(seed))
        return Begun(generator, seed, *self._draw(seed, vehicles))

    def _info(self) -> dict[str, Any]:
        """Return what ``reset`` and ``step`` have in common of ``info``."""
        mask = self._masks() if self._masked else None
        return common_info(self, mask)

    def _start_info(self, rows: npt.NDArray[np.intp]) -> dict[str, Any]:
        """Return what only a reset has in ``info``, of the worlds ``rows`` that begin anew."""
        begun, unsafe = np.zeros((2, self.num_envs), np.bool_)
        begun[rows] = True
        if isinstance(self._check, Strict):
            starts = map(self.scene, rows.tolist())
            unsafe[rows] = [not self._check.start_is_safe(scene) for scene in starts]
        return marked({"unsafe_start": unsafe}, begun)
