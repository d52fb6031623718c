"""The worlds of a training at scale: episodes in the twin, seen wide and paid for speed (ours).

An actor that is to drive sees only what a driver sees; the critic, which only the training needs,
may know more, and its values vary less (Pinto et al. 2018, Asymmetric actor critic).
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from drl_av.arrays import BoolArray, Float32Array, FloatArray, IntArray
from drl_av.compiled import compiled
from drl_av.config import Config
from drl_av.config.learning import SPAN_M_S
from drl_av.driving.actions import ACTIONS, HARD_BRAKE, SIGNS
from drl_av.driving.affordances import LANE, slot_of
from drl_av.driving.wide_observation import WIDE_SIZE, scratch
from drl_av.env.metrics import CHANGE_M_S, CRAWLING_M_S, FORCED_M_S2, SHORT_HEADWAY_S
from drl_av.env.transition import EXIT_MISSED
from drl_av.env.vector import TwinVectorEnv
from drl_av.env.wide_view import look_wide
from drl_av.road.road import RoadNumbers, ahead_m, lane_of
from drl_av.twin.worlds import DESIRED_M_S

SIDES = np.array(SIGNS)
MIDDLE_M_S = 20.0
"""The speed that earns nothing."""
VALUE_SCALE = 10.0
AFTER_CHANGE = 10
"""Number of decisions after a lane change in which it may make others brake."""
REAR_OF = np.array([slot_of(side) + 1 for side in (0, 1, -1)])
"""The slots of the vehicles behind the ego in its lane, and in those to the left and right."""

PLACES_M = np.array([-100.0, 0.0, 40.0, 80.0, 130.0, 200.0, 300.0, 450.0])
"""Between these distances ahead of the ego, and beyond them, the vehicles of each lane count."""
OF_A_PLACE = 3
"""Per lane and place: the vehicles, divided by 5, and the sums of their speeds and of their desired
speeds, each speed as (speed - 20 m/s) / 30 m/s."""


class Part:
    """The worlds of one kind of traffic, and what their rewards need of the decision before."""

    def __init__(self, rows: slice, config: Config, seed: int) -> None:
        self.rows, self._costs = rows, config.ppo
        worlds, mode = rows.stop - rows.start, AutoresetMode.DISABLED
        threads = 2 if worlds == config.ppo.worlds else 1  # several parts have one thread each
        self.env = TwinVectorEnv(worlds, config=config, autoreset_mode=mode, threads=threads)
        drawn = np.random.SeedSequence([seed, rows.start])
        self.env.reset(seed=drawn.generate_state(worlds).tolist())
        self._worlds = np.arange(self.env.num_envs)
        self._trend = np.zeros(self.env.num_envs, np.int64)
        self._since_change = np.full(self.env.num_envs, AFTER_CHANGE)
        self._most = self.env.fleet_of(0).most_in_training
        self.collisions = 0
        """Episodes so far that ended with a collision."""
        self._rng = np.random.default_rng(drawn.spawn(1)[0])

    def step(self, action: IntArray) -> tuple[Float32Array, BoolArray, BoolArray]:
        """Execute one action in each world.

        Returns:
            The rewards; which egos hit something or missed their exit; and which episodes are over
            without that.
        """
        env, costs, (origin, target) = self.env, self._costs, self.env.episodes.lanes.T.copy()
        was_m_s, codes = env.episodes.scene[:, 2].copy(), env.episodes.codes.copy()
        _, _, terminated, truncated, info = env.step(action)
        self.collisions += int(terminated.sum())
        executed, speed, values = info["executed_action"], info["speed_m_s"], env.episodes.values
        reward = (speed - MIDDLE_M_S) / SPAN_M_S
        aborts = (origin != target) & (SIDES[executed // 4] == origin - target)
        change = speed - was_m_s[:, 0]
        trend = np.sign(change) * (np.abs(change) > CHANGE_M_S)
        reversals = trend * self._trend < 0
        self._trend = np.where(trend == 0, self._trend, trend).astype(np.int64)
        has_front = env.episodes.codes[:, 0] > 0
        is_short = has_front & (values[:, 0] < SHORT_HEADWAY_S * speed) & (speed > CRAWLING_M_S)
        forced = self._forced((origin, target), codes, was_m_s)
        reward -= costs.abort_cost * aborts + costs.reversal_cost * reversals
        reward -= costs.hard_brake_cost * (executed % 4 == HARD_BRAKE)
        reward -= costs.short_headway_cost * is_short + costs.forced_brake_cost * forced
        failed = terminated | ((info["way"] == EXIT_MISSED) & ~truncated)
        reward -= costs.collision_cost * failed
        return reward.astype(np.float32), failed, truncated & ~failed

    def _forced(
        self, lanes: tuple[IntArray, IntArray], codes: IntArray, was_m_s: FloatArray
    ) -> BoolArray:
        """Return in which worlds a lane change made a vehicle behind the ego brake.

        On a loop it is the vehicle behind the ego after a decision of the lane change. On an open
        road, where the ego has to change lanes, it is one behind it in its lane or in the lane that
        it enters, during the lane change and for ``AFTER_CHANGE`` decisions after the ego has
        reached the lane.

        Args:
            lanes: The lanes of the lane changes before the decision.
            codes: The codes of the indicators before it, shape (worlds, 10).
            was_m_s: The speed of each vehicle before it, shape (worlds, vehicles).
        """
        (origin, target), episodes = lanes, self.env.episodes
        new_origin, new_target = episodes.lanes.T
        counts = (origin != target) | (new_origin != new_target)
        rears, now_m_s = episodes.codes[:, 1:2], episodes.scene[:, 2, : was_m_s.shape[1]].copy()
        if not self.env.road.is_loop:
            lane = codes[:, LANE]
            stays = episodes.codes[:, LANE] == lane
            self._since_change = np.where(stays, self._since_change + 1, 0)
            side = np.sign(np.where(origin != target, target, new_target) - lane)
            rears = codes[self._worlds[:, None], np.stack((np.ones_like(side), REAR_OF[side]), 1)]
            counts |= self._since_change < AFTER_CHANGE
            for row, kept in self.env.kept.items():
                now_m_s[row] = was_m_s[row]  # those that have left have not braked
                now_m_s[row, kept] = episodes.scene[row, 2, : len(kept)]
        braking = np.take_along_axis(was_m_s - now_m_s, np.maximum(rears, 0), axis=1)
        forced: BoolArray = counts & ((rears > 0) & (braking > FORCED_M_S2)).any(axis=1)
        return forced

    def begin_anew(self, worlds: BoolArray) -> None:
        """Begin a new episode in some worlds, bool of shape (worlds,)."""
        if not worlds.any():
            return
        self._trend[worlds], self._since_change[worlds] = 0, AFTER_CHANGE
        if self._most is None:
            self.env.reset(options={"reset_mask": worlds})
            return
        for world in np.flatnonzero(worlds):
            vehicles = int(self._rng.integers(self._most + 1))
            mask = np.arange(self.env.num_envs) == world
            self.env.reset(options={"reset_mask": mask, "vehicles": vehicles})


class TwinWorlds(VecEnv):
    """W worlds in the twin, divided evenly among the kinds of traffic of ``traffic.presets``.

    The observation is the wide observation, then the mask of the safety check, ``SIZE`` numbers
    which a driver sees. With ``ppo.asymmetric_critic`` the whole road follows, and which kind of
    traffic it is (1 or 0 each), for the critic alone. The reward is the
    speed less costs, times ``VALUE_SCALE`` (1 - discount), so that the size of the value does not
    depend on the discount. Episodes begin at different times.

    Raises:
        ConfigError: the twin cannot do what the settings ask.
    """

    SIZE = WIDE_SIZE + len(ACTIONS)
    """Number of inputs of the actor."""
    PART = Part
    """What drives the worlds of one kind of traffic, and pays for it."""

    def __init__(self, config: Config, seed: int) -> None:
        count, kinds = config.ppo.worlds, self.kinds(config)
        self.observation = np.zeros((count, self.SIZE), np.float32)
        """What a driver sees, shape (W, SIZE)."""
        self.permitted = np.zeros((count, len(ACTIONS)), np.bool_)
        self.paid = 0.0
        """The sum of all rewards so far, before they are scaled."""
        self._scale = VALUE_SCALE * (1.0 - config.ppo.discount)
        ends = np.rint(np.linspace(0, count, len(kinds) + 1)).astype(int).tolist()
        self.parts = [
            self.PART(slice(first, last), kind, seed)
            for first, last, kind in zip(ends[:-1], ends[1:], kinds, strict=True)
        ]
        lanes = len(self.parts[0].env.road.open_lanes)
        more = whole_road_size(lanes) + len(kinds) if config.ppo.asymmetric_critic else 0
        self._whole = np.zeros((count, more), np.float32)
        for number, part in enumerate(self.parts if more else ()):
            self._whole[part.rows, number - len(kinds)] = 1.0
        seen = Box(-np.inf, np.inf, (self.SIZE + more,))
        super().__init__(count, seen, Discrete(len(ACTIONS)))
        self._action, self._pool = np.zeros(count, np.int64), ThreadPoolExecutor(2)
        rng = np.random.default_rng([seed, count])
        for part in self.parts:
            most = part.env.most_decisions
            begins = rng.integers(0, most, part.env.num_envs)
            for decision in range(most):
                _, hit, late = part.step(np.zeros(part.env.num_envs, np.int64))
                part.begin_anew(hit | late | (begins == decision))
            part.collisions = 0
            self._look(part, np.arange(part.env.num_envs))

    @property
    def collisions(self) -> int:
        """Episodes so far that ended with a collision."""
        return sum(part.collisions for part in self.parts)

    @staticmethod
    def kinds(config: Config) -> list[Config]:
        """Return the settings of which each drives an equal part of the worlds."""
        return config.per_traffic_preset

    def _look(self, part: Part, worlds: IntArray) -> None:
        """Update all that is seen of some worlds of one part."""
        self.look(part, worlds)
        if self._whole.shape[1]:
            env, whole = part.env, self._whole[part.rows]
            vehicles = env.episodes.scene, env.worlds.x, env.vehicles + 1
            look_at_whole_road(*vehicles, env.task.road, PLACES_M, worlds, whole)

    def _all(self) -> Float32Array:
        return np.concatenate((self.observation, self._whole), axis=1)

    def look(self, part: Part, worlds: IntArray) -> None:
        """Update the observations and masks of some worlds of one part."""
        self.see(part, worlds, self.observation[part.rows])

    def see(self, part: Part, worlds: IntArray, observation: Float32Array) -> None:
        """Update the masks of worlds of a part; write what is wide, and the mask, elsewhere."""
        env, seen = part.env, (observation, self.permitted[part.rows], *scratch())
        look_wide.fast(env.episodes, env.task, worlds, env.vehicles + 1, *seen)

    def reset(self) -> Float32Array:
        """Return the present observations, shape (W, S); the episodes go on."""
        return self._all()

    def step_async(self, actions: IntArray) -> None:
        """Remember one action for each world, shape (W,)."""
        self._action = actions

    def step_wait(self) -> tuple[Float32Array, Float32Array, BoolArray, list[dict[str, Any]]]:
        """Execute the actions; an episode that ends is followed by a new one."""
        rewards, dones = np.zeros(self.num_envs, np.float32), np.zeros(self.num_envs, np.bool_)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]

        def step(part: Part) -> float:
            rows, first = part.rows, part.rows.start
            reward, hit, late = part.step(self._action[rows])
            rewards[rows], dones[rows] = reward * self._scale, hit | late
            self._look(part, np.arange(part.env.num_envs))
            for row in np.flatnonzero(dones[rows]).tolist():
                seen = self.observation[first + row], self._whole[first + row]
                last, ends = np.concatenate(seen), bool(late[row])
                infos[first + row] = {"terminal_observation": last, "TimeLimit.truncated": ends}
            part.begin_anew(dones[rows])
            self._look(part, np.flatnonzero(dones[rows]))
            return float(reward.sum(dtype=np.float64))

        for paid in self._pool.map(step, self.parts):
            self.paid += paid
        return self._all(), rewards, dones, infos

    def env_method(self, method_name: str, *args: Any, **kwargs: Any) -> list[Any]:
        """Return the rows of ``action_masks``, the only method."""
        return [*self.permitted.copy()]

    def has_attr(self, attr_name: str) -> bool:
        """Whether the worlds have this attribute: ``action_masks`` only."""
        return attr_name == "action_masks"

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return None for each world: there is nothing to draw."""
        return [None] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Do nothing."""

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each world."""
        return [False] * self.num_envs

    def close(self) -> None:
        """Do nothing."""


def whole_road_size(lanes: int) -> int:
    """Return how many numbers describe the vehicles of a road."""
    return lanes * (len(PLACES_M) + 1) * OF_A_PLACE


@compiled
def look_at_whole_road(
    scene: FloatArray,
    x: FloatArray,
    count: IntArray,
    road: RoadNumbers,
    places_m: FloatArray,
    rows: IntArray,
    seen: Float32Array,
) -> None:
    """Fill ``seen[rows]``, shape (worlds, whole_road_size), with all vehicles but the ego.

    ``scene`` is that of ``Episodes``, ``x`` that of ``Worlds``; ``count``, shape (worlds,), holds
    the numbers of vehicles, the ego included. ``places_m`` is ``PLACES_M``.
    """
    lanes, places = len(road.open_lanes), len(places_m) + 1
    for w in rows:
        seen[w, : lanes * places * OF_A_PLACE] = 0.0
        for row in range(1, count[w]):
            away_m = ahead_m(scene[w, 0, 0], scene[w, 0, row], road.lap_m)
            place = 0
            while place < places - 1 and away_m >= places_m[place]:
                place += 1
            lane = min(max(lane_of(scene[w, 1, row], road.lane_width_m), 0), lanes - 1)
            at = (lane * places + place) * OF_A_PLACE
            seen[w, at] += 0.2
            seen[w, at + 1] += (scene[w, 2, row] - 20.0) / 30.0
            seen[w, at + 2] += (x[w, DESIRED_M_S, row] - 20.0) / 30.0
