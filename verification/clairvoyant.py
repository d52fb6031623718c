"""Measures how fast a driver would be that knows the future, by a search in SUMO itself.

    python -m verification.clairvoyant --vehicles 10 15 20 25 --episodes 8 --jobs 2

At every second decision the search tries each of ``PLANS`` in a copy of the process. The copy is
made by ``fork`` and contains SUMO, so the other vehicles act in it exactly as they will act, even
where they decide at random. The safety check is used throughout. A plan is tried for ``HORIZON``
decisions; the driver ``gap-mobil`` decides all that the plan leaves open. The ego then follows the
plan with the longest distance without a collision, or continues its present plan if none is better.
The program prints the mean speed of the search, and its gain over the named drivers in the same
traffic.

The search is not a driver, because it knows random numbers that have not been drawn yet. It is not
an upper bound either: it compares only these plans, and only up to the horizon.
"""

import os
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.cli.options import int_at_least
from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import driving_config, find_drivers, make_drivers
from drl_av.driving.actions import Action, Lateral, Longitudinal, toward
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.evaluation.processes import workers
from drl_av.evaluation.statistics import Speed, paired
from drl_av.road.snapshot import EGO
from drl_av.safety import CHECKS
from verification.program import Program, run_program

HORIZON = 20
"""Number of decisions, of 1 s each, for which a plan is tried."""
INTERVAL = 2
"""Number of decisions from one search to the next."""
BASE = "gap-mobil"
SEARCH = "search"
SEEDS = 920_000
"""Traffic seed of the first episode; the experiment ``real_bounds`` begins with it, too."""


class Plan(NamedTuple):
    """Decisions that the ego makes in order, before the driver ``BASE`` decides alone again."""

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


PLANS = (
    Plan(),
    *(Plan(wait=wait) for wait in (5, 10, HORIZON)),
    *(Plan(wait=brake, brake=brake) for brake in (2, 4)),
    *(
        Plan(wait, 0, (side,), yields, hold)
        for side in (1, -1)
        for wait, yields, hold in (
            (0, False, 0),
            (0, False, HORIZON),
            (0, True, 5),
            (4, False, 5),
            (4, True, 5),
        )
    ),
    *(Plan(0, 0, (side, side), hold=5) for side in (1, -1)),
)
"""The plans; with the first plan the driver ``BASE`` decides everything."""


class Execution:
    """Carries out a plan, decision by decision.

    ``lane`` is the lane of the ego when the plan begins, or the lane into which it is changing.
    """

    def __init__(self, plan: Plan, lane: int) -> None:
        self._plan, self._made = plan, 0
        self._lanes = list(np.cumsum((lane, *plan.sides)))[1:]
        self._held = 0

    def act(self, scene: Scene, usual: Action) -> Action:
        """Return the action of this decision; ``usual`` is the action of ``BASE``."""
        plan, self._made = self._plan, self._made + 1
        if self._made <= plan.wait:
            brakes = self._made <= plan.brake
            return Action(Lateral.KEEP, Longitudinal.BRAKE if brakes else usual.longitudinal)
        if scene.lane_change is None and self._lanes and self._lanes[0] == scene.affordances.lane:
            self._lanes.pop(0)
        if self._lanes:
            sign = int(np.sign(self._lanes[0] - scene.affordances.lane))
            if not scene.affordances.has_lane(sign) and scene.lane_change is None:
                self._lanes.clear()
                return usual
            brakes = plan.yields and scene.lane_change is None
            how = Longitudinal.BRAKE if brakes else usual.longitudinal
            return Action(Lateral.KEEP if scene.lane_change else toward(sign), how)
        self._held += 1
        held = self._held <= plan.hold and scene.lane_change is None
        return Action(Lateral.KEEP, usual.longitudinal) if held else usual


class Search:
    """Drives the ego of one environment by the search."""

    def __init__(self, env: HighwayEnv, base: Driver, plans: Sequence[Plan] = PLANS) -> None:
        self._env, self._base, self._plans = env, base, plans
        self.found_m: float = 0.0
        """Distance that the ego drives in the trial of the plan chosen last, m."""

    def drive(self, seed: int, vehicles: int) -> float:
        """Drive an episode; return the mean of the ego's speeds after each decision, m/s."""
        observation, _ = self._env.reset(seed=seed, options={"vehicles": vehicles})
        self._base.start(seed)
        present, over = self.begun(self._plans[0]), False
        speeds: list[float] = []
        while not over:
            if len(speeds) % INTERVAL == 0:
                present = self.choose(present, observation)
            observation, _, hit, ended, _ = self._env.step(self._action(present, observation))
            speeds.append(self._env.scene.affordances.ego_speed_m_s)
            over = hit or ended
        return float(np.mean(speeds))

    def begun(self, plan: Plan) -> Execution:
        """Return the execution of a plan that begins now."""
        return Execution(plan, self._lane())

    def _lane(self) -> int:
        scene = self._env.scene
        return scene.affordances.lane if scene.lane_change is None else scene.lane_change.target

    def _action(self, present: Execution, observation: npt.NDArray[np.float32]) -> int:
        scene = self._env.scene
        return present.act(scene, self._base.act(scene, observation)).number

    def choose(self, present: Execution, observation: npt.NDArray[np.float32]) -> Execution:
        """Return the best plan's execution; ``present`` if no plan is better."""
        candidates = [present, *map(self.begun, self._plans)]
        ways_m = [in_a_copy(partial(self._way_m, each, observation)) for each in candidates]
        best = int(np.argmax(ways_m))
        self.found_m = ways_m[best]
        return candidates[best]

    def _way_m(self, execution: Execution, observation: npt.NDArray[np.float32]) -> float:
        """Try a plan; return the distance that the ego drives, m, or -inf if it collides."""
        way_m, road = 0.0, self._env.road
        for _ in range(HORIZON):
            before_m = self._env.scene.snapshot.s_m[EGO]
            observation, _, hit, ended, _ = self._env.step(self._action(execution, observation))
            if hit:
                return -np.inf
            way_m += float(road.ahead_m(before_m, self._env.scene.snapshot.s_m[EGO]))
            if ended:
                break
        return way_m


def in_a_copy(function: Callable[[], float]) -> float:
    """Call ``function`` in a copy of this process, and return its result.

    The call has no effect on this process. If it fails in the copy, the copy prints why.

    Raises:
        RuntimeError: the copy ended without a result.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(writer, function().hex().encode())
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(0)
    os.close(writer)
    with open(reader, "rb") as stream:
        data = stream.read()
    os.waitpid(child, 0)
    if not data:
        raise RuntimeError(
            "A copy of the process ended without a result: correct what it printed, if anything, "
            "or free memory."
        )
    return float.fromhex(data.decode())


def episode(config: Config, names: Sequence[str], vehicles: int, seed: int) -> list[Speed]:
    """Drive one episode with the search and with each driver; return their mean speeds."""
    specs = find_drivers([*names, BASE])
    drivers = make_drivers(specs, driving_config(specs, config))
    with closing(HighwayEnv(config=config)) as env:
        searched = Search(env, drivers[BASE]).drive(seed, vehicles)
        results = [drive(env, drivers[name], name, seed, vehicles) for name in names]
    speeds = [Speed(one.driver, vehicles, seed, one.mean_speed_m_s) for one in results]
    return [Speed(SEARCH, vehicles, seed, searched), *speeds]


def main() -> int:
    """Drive the episodes; print mean speeds and gains with 95 % intervals; return 0."""
    parser = Program(__doc__)
    parser.add_argument(
        "--vehicles",
        nargs="+",
        type=int_at_least(1),
        default=[10, 15, 20, 25],
        metavar="N",
        help="numbers of vehicles around the ego (default: 10 15 20 25)",
    )
    parser.number("--episodes", 8, "of each", low=2)
    parser.add_argument(
        "--driver",
        nargs="+",
        default=[BASE, "pretrained"],
        help=f"beside the search (default: {BASE} pretrained)",
    )
    parser.add_argument("--safety-check", choices=CHECKS, default="paper", help="default: paper")
    parser.number("--seed", SEEDS, low=0)
    parser.number("--jobs", 1, "number of processes")
    options = parser.parse_args()
    config = Config().updated("safety", check=options.safety_check)
    names = [spec.name for spec in find_drivers(options.driver)]
    seeds = range(options.seed, options.seed + options.episodes)
    speeds: list[Speed] = []
    with workers(options.jobs) as submit:
        futures = [
            submit(episode, config, options.driver, vehicles, seed)
            for vehicles in options.vehicles
            for seed in seeds
        ]
        for future in futures:
            speeds += future.result()
            print(speeds[-1 - len(names) :], file=sys.stderr, flush=True)
    print(f"{'vehicles':>8}  {'driver':<14}{'speed, m/s':>11}  gain of the search, m/s")
    for gain in paired(speeds, SEARCH, names):
        own = [one.mean_speed_m_s for one in speeds if one[:2] == (gain.baseline, gain.vehicles)]
        mean, half = gain.difference_m_s
        print(
            f"{gain.vehicles:>8}  {gain.baseline:<14}{np.mean(own):>11.2f}  {mean:.2f} ± {half:.2f}"
        )
    print(parser.made_by())
    return 0


if __name__ == "__main__":
    run_program(main)
