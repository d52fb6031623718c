"""``drl_av/Highway-v0``: the ego vehicle on SUMO's circular highway, as a gymnasium environment."""

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.envs.registration import EnvSpec

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, Action, ego_numbers
from drl_av.driving.maneuver import plan_with
from drl_av.driving.observation_scale import ObservationScale
from drl_av.driving.scene import LaneChange, infer_action
from drl_av.env.custom import custom_check, custom_observation_of, custom_reward_of, with_check
from drl_av.env.episode_start import (
    TrafficSetup,
    most_decisions,
    number_of_vehicles,
    require_range,
    reset_options,
    settings_on,
    traffic_seed,
    traffic_setups,
)
from drl_av.env.fork import copy_episode, twin_of
from drl_av.env.observation import ObservationFunction, default_groups, observation_function
from drl_av.env.renderer import renderer_of
from drl_av.env.reward import Rewards
from drl_av.env.scene_values import Observation, SceneValues
from drl_av.env.transition import COMPLETE, RewardFunction, RouteOutcome, Transition, custom_reward
from drl_av.env.vector import TwinVectorEnv
from drl_av.errors import ConfigError
from drl_av.random_streams import kind_of_traffic
from drl_av.road.snapshot import EGO, Snapshot
from drl_av.safety import ActionMask, action_mask, mask_of, named_check
from drl_av.safety.check import Rule, SafetyCheck, Verdict, Verdicts, apply_check, whole_verdicts
from drl_av.safety.strict import Strict
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.simulation.fleet import Fleet
from drl_av.simulation.vehicle_calls import EgoModel


class HighwayEnv(gymnasium.Env[Observation, np.int64], gymnasium.utils.EzPickle):
    """The ego on a highway with other vehicles, one decision a second (Fig. 3 of the paper).

    Actions are ``Discrete(12)``, ``4 * lateral + longitudinal``; observations a ``Box`` of shape
    (27,), float32, about [-1, 1]. The tables of both and of ``info``: ``docs/environment.md``.

    Args:
        scenario: Folder of a scenario, or the name of one that ships with drl-av.
        safety_check: Name of a check, or a function from a scene and an action to a ``Verdict``.
        config: A preset's name, a TOML file, a mapping of sections, or a Config.
        render_mode: None, "human" (sumo-gui) or "rgb_array", which needs no screen.
        action_mask: Whether ``info`` has the mask; True by ``gymnasium.make``.
        reward: Function of a ``Transition``, or its ``MODULE:NAME``, in place of the reward.
        observation: Names of groups of indicators, "wide", or an object with a ``space``.
        sumo_options: Options of SUMO itself, which then starts again at each reset.

    Raises:
        ConfigError, ScenarioError: an argument is wrong, or the scenario missing or damaged.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (gymnasium declares it so)
        "render_modes": ["human", "rgb_array"],
        "render_fps": 1,
    }
    _spec: EnvSpec | None = None

    def __init__(
        self,
        scenario: str | Path | None = None,
        safety_check: str | SafetyCheck | None = None,
        config: Config | Mapping[str, Any] | str | Path | None = None,
        render_mode: str | None = None,
        action_mask: bool = False,
        reward: str | RewardFunction | None = None,
        observation: str | Iterable[str] | ObservationFunction | None = None,
        sumo_options: str | Sequence[str] = (),
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(
                f"render_mode is {render_mode!r}, but must be None, 'human' or 'rgb_array'."
            )
        self.render_mode = render_mode
        config, own_check = with_check(settings_on(config, scenario), safety_check)
        given = {"config": config, "render_mode": render_mode, "action_mask": action_mask}
        parts = {"safety_check": safety_check, "reward": reward, "observation": observation}
        gymnasium.utils.EzPickle.__init__(self, **given, **parts, sumo_options=sumo_options)
        self.config = config
        loaded = load_scenario(find_scenario(config.simulation.scenario))
        types, self.road = loaded.vehicle_types, loaded.road
        self._most_decisions = most_decisions(config, loaded.layout)
        if own_check is None:
            self.safety_check: SafetyCheck = named_check(config, types, self.road)
            self._check_name = config.safety.check
        else:
            self.safety_check = custom_check(own_check, config)
            name = getattr(own_check, "__name__", type(own_check).__name__)
            self._check_name = own_check if isinstance(own_check, str) else str(name)
        self._setups = traffic_setups(config, loaded, render_mode == "human", sumo_options)
        self.simulation, self.traffic_drivers = self._setups[0]
        self._own_reward = None if reward is None else custom_reward_of(reward)
        self.scale = ObservationScale(config.observation, config.ego.max_speed_m_s, self.road)
        groups = default_groups(config.observation) if observation is None else observation
        self.observe = observation_function(custom_observation_of(groups), self.scale)
        self._groups = getattr(self.observe, "groups", self.observe)
        self._values_of = SceneValues(config, self.road, self.scale)
        self._ego = ego_numbers(config.ego, config.simulation)
        self._verdicts: Verdicts | None = None
        self.observation_space = self.observe.space
        self._scaled_only = observation is None and not config.observation.way
        self.action_space = gymnasium.spaces.Discrete(len(ACTIONS))
        self._masked = action_mask
        self._renderer = renderer_of(
            render_mode, self.road, lambda text, colors: self.simulation.show(text, colors)
        )
        self.ego_model: EgoModel | None = None
        self._twin: TwinVectorEnv | None = None
        self._has_own_check = own_check is not None
        self._over = True

    @property
    def spec(self) -> EnvSpec | None:
        """The environment's specification; the config determines its ``max_episode_steps``."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        most = self._most_decisions
        self._spec = None if spec is None else replace(spec, max_episode_steps=most)

    @property
    def check_name(self) -> str:
        """Name of the safety check; ``none`` while SUMO drives the ego, as none applies then."""
        return self._check_name if self.ego_model is None else "none"

    def fleet_of(self, seed: int) -> Fleet:
        """Return the vehicles of the kind of traffic of an episode, by its traffic seed."""
        return kind_of_traffic(seed, self._setups).simulation.fleet

    def require_room(self, vehicles: int | None = None) -> None:
        """Raise an error unless the vehicles fit on the road; do not call it within an episode.

        ``vehicles`` is the number of other vehicles; None stands for ``traffic.vehicles_max``.

        Raises:
            ConfigError: ``traffic.vehicles_max`` vehicles do not fit, or the scenario places
                another number.
            ScenarioError: ``vehicles`` vehicles do not fit.
        """
        fleets = [each.simulation.fleet for each in self._setups]
        if vehicles is not None:
            number_of_vehicles({"vehicles": vehicles}, 0, fleets[0])
            for fleet in fleets:
                fleet.draw(0, vehicles)
            return
        require_range(fleets)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; ``options`` may set ``vehicles``, the number of other vehicles.

        With it, or from 1,000,000 on, ``seed`` is the traffic seed of the episode. A smaller seed
        alone begins a random sequence of episodes, and None continues the sequence.

        Returns:
            The observation, by default of shape (27,), and ``info``.

        Raises:
            ConfigError: an option is wrong, the range of the number of vehicles does not fit on the
                road, or the user's own observation is not in its space.
            ScenarioError: the vehicles do not fit on the road.
            SimulationError: SUMO could not start, or ended unexpectedly.
        """
        super().reset(seed=seed)
        self._over = True
        given = reset_options(options)
        self.seed = traffic_seed(seed, given, self.np_random)
        drawn = kind_of_traffic(self.seed, self._setups)
        if drawn.simulation is not self.simulation:
            self.simulation.close()
            drawn.simulation.after_step = self.simulation.after_step
        self.simulation, self.traffic_drivers = drawn
        fleet = self.simulation.fleet
        if "vehicles" not in given:
            self.require_room()
        vehicles = number_of_vehicles(given, self.seed, fleet)
        self.decisions = self._triggers = 0
        self._speed_sum_m_s = 0.0
        self.ego_model = None
        snapshot = self.simulation.reset(self.seed, vehicles)
        self.traffic_drivers.start(
            fleet.driver_models, fleet.population.desired_speed_m_s, self.seed
        )
        self._observe(snapshot, None)
        self._route = RouteOutcome(self.road, self.scene.indicators)
        info = self._info(self._route.outcome(self.scene.indicators, over=False))
        check = self.safety_check
        info["unsafe_start"] = isinstance(check, Strict) and not check.start_is_safe(self.scene)
        if self._renderer is not None:
            self._renderer.reset(snapshot, self.seed)
        self._over = False
        return self.observation, info

    def hand_over(self, model: EgoModel) -> None:
        """Let SUMO drive the ego, by its IDM and SL2015, until the next reset.

        ``model`` holds the parameters of these two models. The environment then ignores actions and
        the safety check, and ``info`` holds the action that is nearest to the ego's motion.

        Raises:
            gymnasium.error.ResetNeeded: no episode is running.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("There is no episode to hand over: call reset.")
        self.simulation.hand_over(model)
        self.ego_model = model

    def step(self, action: int | np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Execute one decision; the safety check may replace the action by another one.

        Returns:
            The observation, the reward, whether the episode terminated, whether it was truncated,
            and ``info``.

        Raises:
            ConfigError: the action is not a number from 0 to 11, the user's own safety check does
                not return a verdict, or the user's own reward is not a finite number.
            gymnasium.error.ResetNeeded: no episode is running.
            SimulationError: SUMO ended unexpectedly.
        """
        made = self.execute(action)
        over = made.truncated and not made.terminated
        info = self._info(made.route_outcome) | {
            "is_success": over and made.route_outcome in ("", *COMPLETE),
            "mean_speed_m_s": self._speed_sum_m_s / self.decisions,
            "ego_hit": made.collision is not None and made.collision.kind.ego_hit,
            "safety_triggers": self._triggers,
            "proposed_action": made.proposed.number,
            "executed_action": made.executed.number,
            "rule": str(made.rule),
            "rewards": made.terms._asdict(),
            "collision": "" if made.collision is None else made.collision.kind.value,
            "collided_with": "" if made.collision is None else made.collision.other or "",
        }
        return self.observation, made.reward, made.terminated, made.truncated, info

    def execute(self, action: int | np.int64) -> Transition:
        """Execute one decision and return its record, from which ``step`` makes its results.

        Raises the errors of ``step``.
        """
        proposed = self._proposed(action)
        scene, observation, config = self.scene, self._seen, self.config
        verdict = Verdict(proposed, Rule.NONE)
        if self.ego_model is None:
            verdict = self._verdict_on(proposed)
        commands, lane_change = plan_with(scene, verdict.action, self._ego)
        traffic_commands = self.traffic_drivers(scene.snapshot)
        self._over = True  # remains so if SUMO ends during the decision
        snapshot, collision = self.simulation.advance(commands, traffic_commands)
        if self.ego_model is not None:
            proposed, lane_change = infer_action(scene, snapshot, self.road, config)
            verdict = Verdict(proposed, Rule.NONE)
        self.decisions += 1
        terms = self._observe(snapshot, lane_change)
        terminated = collision is not None
        at_the_end = not self.road.is_loop and bool(self.road.end_m <= snapshot.s_m[EGO])
        truncated = self.decisions >= self._most_decisions or at_the_end
        over = terminated or truncated
        self.transition = Transition(
            scene,
            observation,
            proposed,
            verdict.action,
            verdict.rule,
            self.scene,
            self._seen,
            collision,
            terms,
            config.reward.collision_reward if terminated else terms.total,
            terminated,
            truncated,
            self._route.outcome(self.scene.indicators, over),
            self._route.misses_exit(self.scene.indicators),
        )
        self._speed_sum_m_s += float(self.indicators[24])
        self._triggers += self.transition.triggered
        if self._own_reward is not None:
            reward = custom_reward(self._own_reward, self.transition)
            self.transition = self.transition._replace(reward=reward)
        self._over = over
        if self._renderer is not None:
            self._renderer.step(self.transition)
        return self.transition

    def fork(self, n: int, seed: int = 0, include_rng: bool = False) -> TwinVectorEnv:
        """Return ``n`` copies of the running episode in worlds of the twin, for search.

        The arguments are those of ``TwinVectorEnv.fork``. Copies of an episode in the twin go on
        exactly as it does. Those of an episode in SUMO begin with the same scene and drivers, but
        without what SUMO's drivers remember.

        Raises:
            ConfigError: the twin cannot do what the settings ask, or the environment has a check
                of the user, or SUMO drives the ego.
            gymnasium.error.ResetNeeded: no episode is running.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("There is no episode to fork: call reset.")
        if self._has_own_check or self.ego_model is not None:
            raise ConfigError(
                "The worlds of a fork have no safety check of yours and drive the ego without "
                "SUMO: fork an environment that was made so."
            )
        if self._twin is None:
            said = "A fork drives", "fork an episode without it"
            self._twin = twin_of(
                *said, self.config, observation=self._groups, reward=self._own_reward
            )
        episode = TrafficSetup(self.simulation, self.traffic_drivers), self._route, self.scene
        so_far = self.decisions, self._speed_sum_m_s, self._triggers
        copy_episode(self._twin, *episode, self.seed, so_far)
        return self._twin.fork(n, seed, include_rng)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the scene as a picture, uint8 of shape (720, 1280, 3).

        The result is None without a render mode, and in the mode ``human`` (sumo-gui).
        """
        return None if self._renderer is None else self._renderer.render()

    def action_masks(self) -> ActionMask:
        """Return the action mask of the present scene, shape (12,), int8, for sb3-contrib.

        Raises:
            gymnasium.error.ResetNeeded: no episode has begun.
        """
        if "scene" not in vars(self):
            raise gymnasium.error.ResetNeeded("There is no scene yet: call reset.")
        if (verdicts := self._all_verdicts()) is not None:
            return mask_of(verdicts)
        return action_mask(self.safety_check, self.scene)

    def _verdict_on(self, proposed: Action) -> Verdict:
        """Return the verdict of the safety check on an action in the present scene."""
        if (verdicts := self._all_verdicts()) is not None:
            return verdicts.of(proposed)
        return apply_check(self.safety_check, self.scene, proposed)

    def _all_verdicts(self) -> Verdicts | None:
        """Return what ``whole_verdicts`` returns for the present scene, computed once."""
        if self._verdicts is None:
            self._verdicts = whole_verdicts(self.safety_check, self.scene)
        return self._verdicts

    def close(self) -> None:
        """End the episode, and close SUMO."""
        self._over = True
        self.simulation.close()

    def _proposed(self, action: int | np.int64) -> Action:
        """Return the action with this number; raise ConfigError or ResetNeeded if it is refused."""
        if self._over:
            raise gymnasium.error.ResetNeeded("There is no episode to drive on in: call reset.")
        quick = type(action) is int and 0 <= action < len(ACTIONS)  # contains takes 2 % of a step
        if not quick and not self.action_space.contains(action):
            given = " ".join(repr(action).split())
            raise ConfigError(
                f"The action is {given}, but must be one whole number from 0 to {len(ACTIONS) - 1}."
            )
        return ACTIONS[action]

    def _observe(self, snapshot: Snapshot, lane_change: LaneChange | None) -> Rewards:
        """Store the present scene, its indicators and its observation; return its reward terms."""
        self.scene, scaled, terms = self._values_of(snapshot, lane_change)
        self.indicators = self.scene.indicators.values[:27]
        self._verdicts = None
        self.observation: Observation = scaled if self._scaled_only else self.observe(self.scene)
        self._seen = self.observation if self._own_reward is None else deepcopy(self.observation)
        return terms

    def _info(self, route_outcome: str) -> dict[str, Any]:
        """Return the part of ``info`` that ``reset`` and ``step`` have in common."""
        info = {
            "seed": self.seed,
            "vehicles": len(self.scene.snapshot.ids) - 1,
            "speed_m_s": float(self.indicators[24]),
            "indicators": self.indicators.copy(),
            "way": route_outcome,
        }
        if self._masked:
            info["action_mask"] = self.action_masks()
        return info
