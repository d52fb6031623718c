"""``drl_av/Highway-v0``: the ego vehicle on SUMO's circular highway, as a gymnasium environment."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.config.presets import as_config
from drl_av.drawing.renderer import GuiRenderer, PictureRenderer, Renderer
from drl_av.drivers.background.level_k import load_level_1
from drl_av.drivers.background.traffic import TrafficDrivers
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.affordances import INDICATORS, ObservationScale, compute_affordances
from drl_av.driving.maneuver import plan
from drl_av.driving.observed import observed
from drl_av.driving.scene import LaneChange, Scene
from drl_av.env.episode import number_of_vehicles, traffic_seed
from drl_av.env.reward import Rewards, desired, rewards
from drl_av.errors import ConfigError
from drl_av.safety import ActionMask, action_mask, named_check, starts_unsafe
from drl_av.safety.check import Rule, SafetyCheck, Verdict
from drl_av.traffic.ego_model import EgoModel
from drl_av.traffic.scenario import find_scenario, load_scenario
from drl_av.traffic.simulation import Simulation
from drl_av.traffic.snapshot import Collision, Snapshot

Observation = npt.NDArray[np.float32]


class HighwayEnv(gymnasium.Env[Observation, np.int64], gymnasium.utils.EzPickle):
    """The ego on a highway with other vehicles, one decision a second (Fig. 3 of the paper).

    ## Description
    A circular highway of three lanes represents an infinite straight highway. SUMO drives the other
    vehicles. A safety check examines each action of the agent before the ego executes it.

    ## Action Space
    `Discrete(12)`, `4 * lateral + longitudinal`:

    {actions}

    ## Observation Space
    `Box` of shape (27,), float32: the affordance indicators, scaled by the constants of
    `config.observation` and clipped to the box. `info["indicators"]` holds them in SI units.

    {indicators}

    ## Rewards
    The mean of r_v, r_y and r_x (eq. 6 to 8), each in [-1, 0]; `config.reward.collision_reward`
    for the decision in which the ego collides.

    ## Starting State
    The other vehicles are at random positions within 250 m of the ego. Their number is
    `options={{"vehicles": n}}`, or is drawn from the range in the config.

    `reset(seed=7, options={{"vehicles": 30}})` always starts the same episode, which is also that
    of `drl-av evaluate` for these numbers. A seed below 1,000,000 without `vehicles`, which clients
    pass to their first reset, seeds the random choice of episodes for this reset and the following
    resets without a seed. These episodes have seeds of at least 1,000,000, so that no training uses
    an episode of the evaluation. `info["seed"]` holds the seed of the episode; pass it to `reset`
    to start the episode again. Changes that your own program makes in SUMO, such as the permissions
    of a lane, remain until `close`.

    ## Episode End
    The episode terminates when the ego collides. It is truncated after
    `config.simulation.decisions_per_episode` decisions.

    ## Arguments
    `scenario` (folder or name), `safety_check` (name or function), `config` (a preset's name, a
    TOML file, `{{"traffic": {{"vehicles_max": 5}}}}` or a Config),
    `render_mode` ("human" is sumo-gui, "rgb_array" needs no screen), `action_mask` (whether `info`
    contains the mask; True by `gymnasium.make`, False by default in this class).

    ## Information
    `proposed_action, executed_action, rule, rewards, collision, speed_m_s, indicators, seed,
    vehicles, action_mask`. The mask has shape (12,) and type int8. It is 1 for each action that the
    safety check would execute now as proposed; `action_space.sample(mask)` accepts it.
    The info of a reset also holds `unsafe_start`: whether the check `strict` can no longer keep the
    ego from a collision there.

    ## Several at Once
    Each environment has its own SUMO, also within one process. The first environment uses the
    installed libsumo. Each further one loads a copy of the library (30 ms, 17 MiB), which later
    environments reuse after `close`. All environments of one process share one core. To use several
    cores, call `make_vec(..., vectorization_mode="async", vector_kwargs={{"context": "spawn"}})`.
    sumo-gui shows only one environment of a process at a time.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (gymnasium declares it so)
        "render_modes": ["human", "rgb_array"],
        "render_fps": 1,
    }

    def __init__(
        self,
        scenario: str | Path | None = None,
        safety_check: str | SafetyCheck | None = None,
        config: Config | Mapping[str, Any] | str | Path | None = None,
        render_mode: str | None = None,
        action_mask: bool = False,
    ) -> None:
        gymnasium.utils.EzPickle.__init__(
            self, scenario, safety_check, config, render_mode, action_mask
        )
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(
                f"render_mode is {render_mode!r}, but must be None, 'human' or 'rgb_array'."
            )
        self.render_mode = render_mode
        config = as_config(config)
        if scenario is not None:
            folder = Path(scenario)
            name = str(folder.absolute() if folder.is_dir() else scenario)
            config = config.updated("simulation", scenario=name)
        if safety_check is not None and not callable(safety_check):
            config = config.updated("safety", check=safety_check)
        self.config = config
        self._check_name = (
            getattr(safety_check, "__name__", "custom")
            if callable(safety_check)
            else config.safety.check
        )
        loaded = load_scenario(find_scenario(config.simulation.scenario))
        types, self.road = loaded.vehicle_types, loaded.road
        self.safety_check = (
            safety_check if callable(safety_check) else named_check(config, types, self.road)
        )
        self.simulation = Simulation(loaded, config, gui=render_mode == "human")
        level_1 = load_level_1(self.road) if config.traffic.level_1_share else None
        self.traffic_drivers = TrafficDrivers(config, self.road, types, level_1)
        self.scale = ObservationScale(config.observation, config.ego.max_speed_m_s, self.road)
        bounds = self.scale.bounds
        self.observation_space = gymnasium.spaces.Box(-bounds, bounds, dtype=np.float32)
        self.action_space = gymnasium.spaces.Discrete(len(ACTIONS))
        self._masked = action_mask
        self._renderer = self._renderer_of(render_mode)
        self.ego_model: EgoModel | None = None
        self._over = True

    @property
    def check_name(self) -> str:
        """Name of the safety check; ``none`` while SUMO drives the ego without a check."""
        return self._check_name if self.ego_model is None else "none"

    def require_room(self) -> None:
        """Raise ConfigError if ``traffic.vehicles_max`` vehicles do not fit on the road."""
        most = self.simulation.capacity
        if self.config.traffic.vehicles_max > most and self.simulation.placed_vehicles is None:
            raise ConfigError(
                f"traffic.vehicles_max is {self.config.traffic.vehicles_max}, but this road takes "
                f"{most} vehicles besides the ego: ask for fewer or make the loop longer."
            )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; ``options`` may set ``vehicles``, the number of other vehicles.

        Returns:
            The observation, shape (27,), and ``info``.

        Raises:
            ConfigError: an option is unknown, or the number of vehicles is not allowed.
            ScenarioError: the vehicles do not fit on the road.
        """
        super().reset(seed=seed)
        options = options or {}
        self.seed = traffic_seed(seed, options, self.np_random)
        placed = self.simulation.placed_vehicles
        vehicles = number_of_vehicles(options, self.seed, self.config.traffic, placed)
        self.decisions = 0
        self.ego_model = None
        self._over = True
        snapshot = self.simulation.reset(self.seed, vehicles)
        self.traffic_drivers.start(
            self.simulation.kinds, self.simulation.desired_speed_m_s, self.seed
        )
        observation, info = self._observe(snapshot, None), self._info()
        info["unsafe_start"] = starts_unsafe(self.safety_check, self.scene)
        self._renderer.reset(snapshot, info)
        self._over = False
        return observation, info

    def hand_over(self, model: EgoModel) -> None:
        """Let SUMO drive the ego with its own models until the next reset.

        The environment then ignores actions and the safety check, and ``info`` holds the actions
        that are nearest to the ego's motion.

        Raises:
            gymnasium.error.ResetNeeded: no episode is running.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("There is no episode to hand over: call reset.")
        self.simulation.hand_over(model)
        self.ego_model = model

    def step(self, action: int | np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Execute an action for one decision, or the action that the safety check replaces it by.

        Returns:
            The observation, shape (27,), the reward, whether the episode terminated, whether it was
            truncated, and ``info``.

        Raises:
            ConfigError: the action is not a number from 0 to 11.
            gymnasium.error.ResetNeeded: no episode is running.
            SimulationError: SUMO ended unexpectedly.
        """
        proposed = self._proposed(action)
        scene, config = self.scene, self.config
        verdict = self.safety_check(scene, proposed)
        commands, lane_change = plan(scene, verdict.action, config.ego, config.simulation)
        traffic_commands = self.traffic_drivers(scene.snapshot)
        self._over = True  # if SUMO ends during the decision
        snapshot, collision = self.simulation.advance(commands, traffic_commands)
        if self.ego_model is not None:
            proposed, lane_change = observed(scene, snapshot, self.road, config)
            verdict = Verdict(proposed, Rule.NONE)
        self.decisions += 1
        observation = self._observe(snapshot, lane_change)
        reward, terms = self._reward(collision)
        terminated = collision is not None
        truncated = self.decisions >= config.simulation.decisions_per_episode
        self._over = terminated or truncated
        info = self._info() | {
            "proposed_action": proposed.number,
            "executed_action": verdict.action.number,
            "rule": str(verdict.rule),
            "rewards": terms._asdict(),
            "collision": collision,
        }
        self._renderer.step(snapshot, reward, info)
        return observation, reward, terminated, truncated, info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """The scene as a picture, uint8 of shape (720, 1280, 3); None if sumo-gui shows it."""
        return self._renderer.render()

    def action_masks(self) -> ActionMask:
        """The action mask of the present scene, shape (12,), int8; sb3-contrib calls it."""
        return action_mask(self.safety_check, self.scene)

    def close(self) -> None:
        """End SUMO and the episode."""
        self._over = True
        self.simulation.close()

    def _proposed(self, action: int | np.int64) -> Action:
        if self._over:
            raise gymnasium.error.ResetNeeded("There is no episode to drive on in: call reset.")
        quick = type(action) is int and 0 <= action < len(ACTIONS)  # contains costs a step 2 %
        if not quick and not self.action_space.contains(action):
            raise ConfigError(f"The action is {action}, but must be from 0 to {len(ACTIONS) - 1}.")
        return ACTIONS[action]

    def _observe(self, snapshot: Snapshot, lane_change: LaneChange | None) -> Observation:
        affordances = compute_affordances(snapshot, self.road, self.config.observation.range_m)
        self.scene = Scene(snapshot, affordances, lane_change)
        self.indicators = affordances.vector()
        return self.scale(self.indicators)

    def _reward(self, collision: Collision | None) -> tuple[float, Rewards]:
        config, affordances = self.config, self.scene.affordances
        target = desired(affordances, config.reward, config.safety)
        terms = rewards(affordances, target, config.reward, config.safety.minimum_gap_m)
        return terms.total if collision is None else config.reward.collision_reward, terms

    def _renderer_of(self, render_mode: str | None) -> Renderer:
        if render_mode == "rgb_array":
            return PictureRenderer(self.road)
        return Renderer() if render_mode is None else GuiRenderer(self.simulation.show)

    def _info(self) -> dict[str, Any]:
        info = {
            "seed": self.seed,
            "vehicles": len(self.scene.snapshot.ids) - 1,
            "speed_m_s": self.scene.affordances.ego_speed_m_s,
            "indicators": self.indicators.copy(),
        }
        if self._masked:
            info["action_mask"] = self.action_masks()
        return info


HighwayEnv.__doc__ = str(HighwayEnv.__doc__).format(
    actions="\n    ".join(
        ["| action | meaning |", "| --- | --- |"]
        + [f"| {action.number} | {action} |" for action in ACTIONS]
    ),
    indicators="\n    ".join(
        ["| place | indicator |", "| --- | --- |"]
        + [f"| {place} | {name} |" for place, name in enumerate(INDICATORS)]
    ),
)
