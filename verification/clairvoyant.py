"""Measures how fast a driver would be that knows the future, by a search in the compiled twin.

    python -m verification.clairvoyant --vehicles 10 15 20 25 --episodes 100 --jobs 2

At every second decision the search tries each of ``PLANS`` in a copy of the episode
(``TwinVectorEnv.fork``), in which the other vehicles act exactly as they will act, with the random
lane changes that they will make. The safety check is used throughout. A plan is tried for
``HORIZON`` decisions; the driver ``--base`` decides all that the plan leaves open. The ego then
follows the plan with the longest distance without a collision, or continues its present plan if
none is better. The program prints the mean speed of the named drivers in the same traffic of the
twin, and the gain of the search over them.

The search is not a driver, because it knows random numbers that have not been drawn yet. It is not
an upper bound either: it compares only these plans, and only up to the horizon.
"""

import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode

from drl_av.arrays import FloatArray, IntArray
from drl_av.config import Config
from drl_av.drivers.registry import driving_config, find_drivers, make_drivers
from drl_av.driving.actions import BRAKE, KEEP, LEFT, RIGHT
from drl_av.driving.affordances import LANE, has_lane
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeResult
from drl_av.env.rollout import drive
from drl_av.env.vector import TwinVectorEnv
from drl_av.errors import ConfigError
from drl_av.evaluation.engines import workers
from drl_av.evaluation.statistics import paired
from verification.program import Program, run_program

HORIZON = 20
"""Number of decisions, of 1 s each, for which a plan is tried."""
INTERVAL = 2
"""Number of decisions from one search to the next."""
DRIVERS = ("gap-mobil", "pretrained", "planner")
SEARCH = "search"
SEEDS = 920_000
"""Traffic seed of the first episode."""
Policy = Callable[[TwinVectorEnv], IntArray]
"""A function that returns an action for each world, shape (worlds,)."""


class Plan(NamedTuple):
    """Decisions that the ego makes in order, before the base decides alone again."""

    wait: int = 0
    """Number of decisions for which the ego keeps its lane first."""
    brake: int = 0
    """Number of these decisions in which the ego brakes, from the first on."""
    sides: tuple[int, ...] = ()
    """The lane changes that follow, in this order: left +1, right -1."""
    yields: bool = False
    """Whether the ego brakes until the check permits the lane change."""
    hold: int = 0
    """Number of decisions for which the ego keeps its lane after the lane changes."""


CHANGES = (0, False, 0), (0, False, HORIZON), (0, True, 5), (4, False, 5), (4, True, 5)
"""The plans with one lane change: ``wait``, ``yields`` and ``hold``."""
PLANS = (
    Plan(),
    *(Plan(wait=wait) for wait in (5, 10, HORIZON)),
    *(Plan(wait=brake, brake=brake) for brake in (2, 4)),
    *(Plan(wait, 0, (side,), yields, hold) for side in (1, -1) for wait, yields, hold in CHANGES),
    *(Plan(0, 0, (side, side), hold=5) for side in (1, -1)),
)
"""The plans; with the first plan the base decides everything."""


class Execution:
    """Carries out a plan, decision by decision.

    ``lane`` is the lane of the ego when the plan begins, or the lane into which it is changing.
    """

    def __init__(self, plan: Plan, lane: int) -> None:
        self._plan, self._made, self._held = plan, 0, 0
        self._lanes = np.cumsum((lane, *plan.sides)).tolist()[1:]

    def act(self, codes: IntArray, is_changing: bool, usual: int) -> int:
        """Return the number of the action of this decision.

        ``codes`` is that of ``indicators``; ``usual`` is the action of the base.
        """
        plan, along, self._made = self._plan, usual % 4, self._made + 1
        if self._made <= plan.wait:
            return 4 * KEEP + (BRAKE if self._made <= plan.brake else along)
        if not is_changing and self._lanes and self._lanes[0] == codes[LANE]:
            self._lanes.pop(0)
        if self._lanes:
            sign = int(np.sign(self._lanes[0] - codes[LANE]))
            if is_changing:
                return 4 * KEEP + along
            if not has_lane(codes, sign):
                self._lanes.clear()
                return usual
            return 4 * (LEFT if sign > 0 else RIGHT) + (BRAKE if plan.yields else along)
        self._held += 1
        held = self._held <= plan.hold and not is_changing
        return 4 * KEEP + along if held else usual


class Search:
    """Drives the ego of a twin with one world by the search."""

    def __init__(self, env: TwinVectorEnv, base: Policy, plans: Sequence[Plan] = PLANS) -> None:
        self._env, self._base, self._plans = env, base, plans

    def drive(self, seed: int, vehicles: int) -> float:
        """Drive an episode; return the mean of the ego's speeds after each decision, m/s."""
        self._env.reset(seed=seed, options={"vehicles": vehicles})
        present, over, speeds = self.begun(self._plans[0]), False, list[float]()
        while not over:
            if len(speeds) % INTERVAL == 0:
                present = self.choose(present)
            *_, hit, ended, info = self._env.step(actions([present], self._env, self._base))
            speeds.append(float(info["speed_m_s"][0]))
            over = bool(hit[0] or ended[0])
        return float(np.mean(speeds))

    def begun(self, plan: Plan) -> Execution:
        """Return the execution of a plan that begins now."""
        return Execution(plan, int(self._env.episodes.lanes[0, 1]))

    def choose(self, present: Execution) -> Execution:
        """Return the best plan's execution; ``present`` if no plan is better."""
        candidates = [present, *map(self.begun, self._plans)]
        return candidates[int(np.argmax(self.ways_m(deepcopy(candidates))))]

    def ways_m(self, tried: Sequence[Execution]) -> FloatArray:
        """Try plans; return the distance that the ego drives with each, m; -inf for a collision."""
        copies = self._env.fork(len(tried), include_rng=True)
        ways_m, place_m = np.zeros(len(tried)), copies.episodes.scene[:, 0, 0].copy()
        for _ in range(HORIZON):
            _, _, hit, ended, _ = copies.step(actions(tried, copies, self._base))
            before_m, place_m = place_m, copies.episodes.scene[:, 0, 0].copy()
            ways_m += np.where(hit, -np.inf, self._env.road.ahead_m(before_m, place_m))
            if (hit | ended).all():
                break
        return ways_m


def actions(executions: Sequence[Execution], worlds: TwinVectorEnv, base: Policy) -> IntArray:
    """Return the action of each execution in its world."""
    episodes = worlds.episodes
    changing = episodes.lanes[:, 0] != episodes.lanes[:, 1]
    given = zip(executions, episodes.codes, changing.tolist(), base(worlds).tolist(), strict=True)
    return np.array([each.act(*scene) for each, *scene in given])


def policy(name: str, config: Config) -> Policy:
    """Return a driver by name as a policy; one trained at scale decides in all worlds at once."""
    from drl_av.env.wide_view import most_probable_actions  # it does not go to processes

    [spec] = find_drivers([name])
    if spec.is_planner:
        raise ConfigError("The planner is no base of a search, because it searches: name another.")
    if spec.actor is not None:
        return partial(most_probable_actions, spec.actor[0])
    [driver] = make_drivers([spec], driving_config([spec], config)).values()

    def one_by_one(worlds: TwinVectorEnv) -> IntArray:
        seen = enumerate(worlds.episodes.observation)
        return np.array([driver.act(worlds.scene(row), each).number for row, each in seen])

    return one_by_one


def episode(
    config: Config, base: str, names: Sequence[str], vehicles: int, seed: int
) -> list[EpisodeResult]:
    """Drive one episode with the search and with each driver; return their results.

    Of the search's result only the driver's name, the traffic and the mean speed are its own.
    """
    twin = TwinVectorEnv(config=config, autoreset_mode=AutoresetMode.DISABLED)
    searched = Search(twin, policy(base, config)).drive(seed, vehicles)
    specs = find_drivers(names)
    drivers = make_drivers(specs, driving_config(specs, config))
    with closing(HighwayEnv(config=config)) as env:
        results = [drive(env, drivers[name], name, seed, vehicles) for name in names]
    return [replace(results[0], driver=SEARCH, mean_speed_m_s=searched), *results]


def main() -> int:
    """Drive the episodes; print mean speeds and gains with 95 % intervals; return 0."""
    parser = Program(__doc__)
    parser.numbers("--vehicles", (10, 15, 20, 25), "around the ego")
    parser.number("--episodes", 100, "of each", low=2)
    parser.add_argument("--base", default="pretrained", help="default: pretrained")
    parser.drivers(*DRIVERS)
    parser.number("--jobs", 1, "number of processes")
    options = parser.parse_args()
    config = Config().with_traffic("calm").updated("simulation", world="twin")
    config = config.updated("safety", check="strict")
    names = [spec.name for spec in find_drivers(options.driver)]
    seeds = range(SEEDS, SEEDS + options.episodes)
    rows: list[EpisodeResult] = []
    with workers(options.jobs) as submit:
        futures = [
            submit(episode, config, options.base, names, vehicles, seed)
            for vehicles in options.vehicles
            for seed in seeds
        ]
        for future in futures:
            rows += future.result()
            driven = rows[-1 - len(names) :]
            said = [(row.driver, row.vehicles, row.seed, row.mean_speed_m_s) for row in driven]
            print(said, file=sys.stderr, flush=True)
    print(f"{'vehicles':>8}  {'driver':<16}{'speed, m/s':>11}  gain of the search, m/s")
    for gain in paired(rows, SEARCH, names):
        of = gain.baseline, gain.vehicles
        own = [row.mean_speed_m_s for row in rows if (row.driver, row.vehicles) == of]
        speed = np.mean(own)
        print(f"{gain.vehicles:>8}  {gain.baseline:<16}{speed:>11.2f}  {gain.difference_m_s}")
    print(parser.made_by())
    return 0


if __name__ == "__main__":
    run_program(main)
