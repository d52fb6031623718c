"""Measures how drivers merge from an on-ramp and leave by an off-ramp, at several traffic flows.

    python -m verification.ramps --kind merge --episodes 100
    python -m verification.ramps --kind exit ramp_to_ramp --driver sumo --flow 1000 2000

Prints one line for each kind of road, flow and driver. An episode is a success if the ego is on
the highway where the acceleration lane has ended, or if it takes its exit. The ego waits while it
stands in a lane that it must leave.

There is braking behind the ego if the nearest vehicle behind it, in its lane or in the lane that it
enters, brakes harder than 3 m/s^2. Such braking counts during a mandatory lane change of the ego,
and for 10 s after the ego has reached the next lane. The ego forces the braking if IDM demands more
than 2 m/s^2 of that vehicle, as in MOBIL's safety criterion, before or after that second. Otherwise
the vehicle brakes for another reason, such as a slower vehicle to its left, which it may not pass
on the right.

The time lost is the mean time to the end of the road in the successful episodes, minus the time of
the same driver on the empty road. Intervals are Wilson's at 95 %. The exit status is 1 if the ego
hit anything.
"""

import math
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from statistics import fmean

from drl_av.config import Config, MobilConfig
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import DriverSpec, default_config, find_drivers, make_drivers
from drl_av.driving.car_following import idm_acceleration
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.env.transition import COMPLETE, EXIT_MISSED, Transition
from drl_av.evaluation.criterion import wilson
from drl_av.road.snapshot import Snapshot
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.road_types import ROAD_TYPES
from studies.results import markdown_table
from verification.program import Program, run_program

SEEDS = 760_000
FLOWS = (0, 500, 1000, 1500, 2000)
STANDING_M_S = 0.5
HARD_M_S2 = 3.0
DEMANDED_M_S2 = 2.0
"""The ego forces braking behind it if IDM demands more than this: its comfortable braking."""
AFTER_CHANGE = 10
"""Number of decisions after a lane change in which braking behind the ego counts."""
SUCCESS = {
    "merge": ("merged", "on the highway"),
    "exit": ("took the exit", "in the exit lane"),
    "ramp_to_ramp": ("took the exit", "in the exit lane"),
}
"""By kind of road: what is a success, and where the ego is after its last mandatory lane change."""
PRINTED = re.compile(
    r"^\w+, (?P<driver>\S+), .* asked, (?P<flow>\d+) found: (?P<episodes>\d+) episodes, "
    r"[a-z ]+ (?P<success>\S+ \(.*?\)), ego hits (?P<hits>\d+), .*? waited (?P<waited>\S+) "
    r".*? time lost (?P<lost>.*?), braking behind (?P<behind>\S+ \(.*?\)), "
    r"forced (?P<forced>\S+ \(.*?\))",
    re.MULTILINE,
)
"""Matches a line that this program prints."""


@dataclass
class Trip:
    """The outcome of one episode; the module's docstring defines success, waiting and forcing."""

    success: bool = False
    ego_hit: bool = False
    was_hit: bool = False
    braking_behind: bool = False
    forced: bool = False
    waits: int = 0
    """Number of decisions at whose end the ego stood in a lane that it must leave."""
    decisions: int | None = None
    """Number of decisions until no mandatory lane change was left; None if one was never made."""
    end_s: float | None = None
    """Time to the end of the road, seconds; None if the ego did not reach it."""
    flow_per_h: float = 0.0
    """Measured flow in the episode, per lane of the highway, at the end of the last ramp's lane."""


def drive(env: HighwayEnv, driver: Driver, seed: int, vehicles: int | None = None) -> Trip:
    """Drive one episode with the driver, and return its outcome.

    ``vehicles`` is the number of other vehicles at the start; None means the number that the
    flow of the scenario gives.
    """
    trip, made, changed = Trip(), 0, -math.inf
    road, passed = env.road, 0
    ramp_m = road.partial_lanes[-1].joined_to_m
    usual = env.simulation.fleet.default_vehicle_count if vehicles is None else vehicles
    for decision in rollout(env, driver, seed, usual):
        made += 1
        before, after = decision.scene, decision.next_scene
        demanded, left = before.affordances.mandatory.lanes, after.affordances.mandatory.lanes
        way, ego_m = decision.route_outcome, float(after.snapshot.s_m[0])
        trip.waits += left != 0 and after.affordances.ego_speed_m_s < STANDING_M_S
        if demanded * (after.affordances.lane - before.affordances.lane) > 0:
            changed = made
        if trip.decisions is None and left == 0 and way != EXIT_MISSED:
            trip.decisions = made
        if made - changed <= AFTER_CHANGE or (demanded and before.lane_change is not None):
            braking = list(_demanded_of_braking_vehicles(decision, env.config.mobil))
            trip.braking_behind |= bool(braking)
            trip.forced |= max(braking, default=0.0) > DEMANDED_M_S2
        collision = decision.collision
        if collision is not None:
            trip.ego_hit, trip.was_hit = collision.kind.ego_hit, not collision.kind.ego_hit
        trip.success |= collision is None and way in COMPLETE
        passed += _passes(before.snapshot, after.snapshot, ramp_m)
        if ego_m >= road.end_m:
            over_m = ego_m - road.end_m
            trip.end_s = made - over_m / (ego_m - float(before.snapshot.s_m[0]))
    trip.flow_per_h = 3600 * passed / made / (len(road.open_lanes) - 1)
    return trip


def _demanded_of_braking_vehicles(decision: Transition, mobil: MobilConfig) -> Iterator[float]:
    """Yield the braking, m/s^2, that IDM demands of each vehicle that brakes hard behind the ego.

    These vehicles are the nearest ones in the ego's lane and in the lane that it enters. IDM has
    the parameters of MOBIL without a desired speed, and demands the braking behind the ego before
    or after the decision, whichever is harder.
    """
    before, after = decision.scene, decision.next_scene
    affordances, change = before.affordances, before.lane_change
    for side in (0,) if change is None else (0, change.target - affordances.lane):
        rear = affordances.rear(side)
        name = "" if rear is None else before.snapshot.ids[rear.vehicle]
        if rear is None or name not in after.snapshot.ids:
            continue
        lost = affordances.ego_speed_m_s + rear.relative_speed_m_s
        lost -= float(after.snapshot.speed_m_s[after.snapshot.ids.index(name)])
        if lost > HARD_M_S2:
            yield max(_demanded(scene, name, mobil) for scene in (before, after))


def _demanded(scene: Scene, name: str, mobil: MobilConfig) -> float:
    """Return the braking that IDM demands of a vehicle behind the ego, m/s^2.

    The result is 0 if the vehicle is not the nearest behind the ego in any lane.
    """
    seen = scene.affordances
    for rear in map(seen.rear, (0, 1, -1)):
        if rear is not None and scene.snapshot.ids[rear.vehicle] == name:
            closing_m_s = rear.relative_speed_m_s
            speed_m_s = seen.ego_speed_m_s + closing_m_s
            return -idm_acceleration(speed_m_s, math.inf, rear.gap_m, closing_m_s, mobil)
    return 0.0


def _passes(before: Snapshot, after: Snapshot, s_m: float) -> int:
    """Return how many vehicles besides the ego pass the position ``s_m`` within a decision."""
    behind = {name for name, at in zip(before.ids, before.s_m, strict=True) if at < s_m}
    ahead = {name for name, at in zip(after.ids, after.s_m, strict=True) if at >= s_m}
    return len((behind & ahead) - {"ego"})


def interval(successes: int, trials: int) -> str:
    """Return the share of successes in percent as text, with Wilson's interval at 95 %."""
    share, low, high = wilson(successes, trials)
    return f"{share:.1%} ({max(low, 0.0):.1%} to {min(high, 1.0):.1%})"


def time_lost(trips: Sequence[Trip], empty_s: float | None) -> str:
    """Return the mean time lost of the successful trips as text.

    ``empty_s`` is the time on the empty road; None if the driver did not reach its end.
    """
    ends_s = [trip.end_s for trip in trips if trip.success and trip.end_s is not None]
    if empty_s is None or not ends_s:
        return "time lost unknown"
    return f"time lost {fmean(ends_s) - empty_s:z.1f} s"


def line(kind: str, name: str, flow: float, trips: Sequence[Trip], empty_s: float | None) -> str:
    """Return the line of text on all episodes of one driver on one kind of road at one flow."""
    n = len(trips)
    success, where = SUCCESS[kind]
    made = [trip.decisions for trip in trips if trip.decisions is not None]
    return (
        f"{kind}, {name}, {flow:g} vehicles/h/lane asked, "
        f"{fmean(trip.flow_per_h for trip in trips):.0f} found: {n} episodes, "
        f"{success} {interval(sum(trip.success for trip in trips), n)}, "
        f"ego hits {sum(trip.ego_hit for trip in trips)}, "
        f"hit by others {sum(trip.was_hit for trip in trips)}, "
        f"waited {interval(sum(trip.waits > 0 for trip in trips), n)}, "
        f"longest wait {max(trip.waits for trip in trips)} s, "
        f"{where} after {sum(made) / max(len(made), 1):.1f} s, "
        f"{time_lost(trips, empty_s)}, "
        f"braking behind {interval(sum(trip.braking_behind for trip in trips), n)}, "
        f"forced {interval(sum(trip.forced for trip in trips), n)}"
    )


def table(text: str) -> str:
    """Return the Markdown table of what this program printed: one row for each flow and driver."""
    columns = {"flow": "vehicles/h/lane", "driver": "driver", "episodes": "episodes"}
    columns |= {"success": "success", "hits": "ego hits", "waited": "waited"}
    columns |= {"lost": "time lost", "behind": "braking behind", "forced": "forced"}
    found = [each.groupdict() for each in PRINTED.finditer(text)]
    for each in found:
        each["driver"] = f"`{each['driver']}`"
        for share in ("behind", "forced"):
            each[share] = each[share].split(" ")[0]
    return markdown_table([*columns.values()], [[each[key] for key in columns] for each in found])


def main() -> int:
    """Drive each driver on each kind of road at each flow and print its line."""
    parser = Program(__doc__)
    parser.some("--kind", SUCCESS, ["merge"])
    parser.number("--episodes", 100, "for each printed line")
    parser.drivers("gap-mobil")
    parser.numbers("--flow", FLOWS, "vehicles/h on each lane of the highway", low=0)
    parser.number("--seed", SEEDS, "of the first episode", low=0)
    options = parser.parse_args()
    hits = 0
    specs = find_drivers(options.driver)
    seeds = range(options.seed, options.seed + options.episodes)
    with tempfile.TemporaryDirectory() as home:
        for kind, flow in product(options.kind, options.flow):
            folder = Path(home, f"{kind}_{flow:g}")
            write_scenario(folder, replace(ROAD_TYPES[kind](), flow_per_h=flow))
            for spec in specs:
                config = driven_with(spec, folder)
                [driver] = make_drivers([spec], config).values()
                with closing(HighwayEnv(config=config)) as env:
                    empty_s = drive(env, driver, options.seed, vehicles=0).end_s
                    trips = [drive(env, driver, seed) for seed in seeds]
                hits += sum(trip.ego_hit for trip in trips)
                print(line(kind, spec.name, flow, trips, empty_s), flush=True)
    print(parser.made_by())
    return 1 if hits else 0


def driven_with(spec: DriverSpec, scenario: Path) -> Config:
    """Return the config of an environment for a driver, with ``calm`` traffic.

    A learned driver has the observation and the limits of the ego with which it was trained.
    """
    own = default_config([spec])
    calm = Config().with_traffic("calm")
    config = replace(calm, observation=own.observation, ego=own.ego)
    return config.updated("safety", check="strict").updated("simulation", scenario=str(scenario))


if __name__ == "__main__":
    run_program(main)
