"""How drivers merge from an on-ramp, against the flow on the highway.

    python -m verification.merging --episodes 100
    python -m verification.merging --driver sumo --flow 1000 2000 --episodes 20

Prints one line for each driver and flow. An episode counts as merged if the ego is on the highway
where the acceleration lane has ended. The ego waits while it stands on the ramp or on that lane.
It forces a vehicle to brake if the nearest vehicle behind it, in its lane or in the one that it
enters, brakes harder than 3 m/s^2 from the start of the merge until 10 s after it. Intervals are
Wilson's at 95 %. Exits with 1 if the ego hit anything.
"""

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from drl_av.config import Config
from drl_av.drivers.registry import rule_driver
from drl_av.env.decision import Decision
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.experiments.provenance import made_by
from drl_av.safety import CHECKS
from drl_av.traffic.merge import MergeDescription
from drl_av.traffic.scenario import write_scenario
from drl_av.traffic.snapshot import Snapshot

SEEDS = 760_000
FLOWS = (0.0, 500.0, 1000.0, 1500.0, 2000.0)
STANDING_M_S = 0.5
FORCED_M_S2 = 3.0
AFTER_MERGE = 10
"""Decisions after the merge in which a vehicle behind counts as forced to brake."""


@dataclass
class Merge:
    """The outcome of one episode; the module's docstring defines merging, waiting and forcing."""

    merged: bool = False
    ego_hit: bool = False
    was_hit: bool = False
    forced: bool = False
    waits: int = 0
    """Decisions at which the ego stood in lane 0."""
    decisions: int | None = None
    """Decisions until the ego's centre was on the highway; None if it never was."""
    flow_per_h: float = 0.0
    """Flow on a lane of the highway where the ramp joins it, as it was in the episode."""


def drive(env: HighwayEnv, name: str, seed: int) -> Merge:
    """Drive one episode with the driver ``name``, and return its outcome."""
    merge, made = Merge(), 0
    passed, lanes = 0, len(env.road.open_lanes) - 1
    end_m = env.road.barriers[0].s_m
    for decision in rollout(env, rule_driver(name, env.config), seed, env.simulation.fleet.usual):
        made += 1
        before, after = decision.scene, decision.next_scene
        lane = after.affordances.lane
        merge.waits += lane == 0 and after.affordances.ego_speed_m_s < STANDING_M_S
        if merge.decisions is None and lane > 0:
            merge.decisions = made
        begun = before.lane_change is not None or merge.decisions is not None
        if begun and (merge.decisions is None or made - merge.decisions <= AFTER_MERGE):
            merge.forced |= _hardest_braking_behind(decision) > FORCED_M_S2
        collision = decision.collision
        if collision is not None:
            merge.ego_hit, merge.was_hit = collision.kind.ego_hit, not collision.kind.ego_hit
        merge.merged |= float(after.snapshot.s_m[0]) > end_m and lane > 0 and collision is None
        passed += _passes(before.snapshot, after.snapshot, end_m)
    merge.flow_per_h = 3600 * passed / made / lanes
    return merge


def _hardest_braking_behind(decision: Decision) -> float:
    """Return the hardest braking of the vehicles behind the ego within a decision, m/s^2.

    These are the nearest ones in the ego's lane and in the lane that it enters. The result is 0 if
    there is none, or if none brakes.
    """
    affordances, after = decision.scene.affordances, decision.next_scene.snapshot
    change = decision.scene.lane_change
    sides = (0,) if change is None else (0, change.target - affordances.lane)
    hardest = 0.0
    for side in sides:
        rear = affordances.rear(side)
        name = "" if rear is None else decision.scene.snapshot.ids[rear.vehicle]
        if rear is not None and name in after.ids:
            lost = affordances.ego_speed_m_s + rear.relative_speed_m_s
            hardest = max(hardest, lost - float(after.speed_m_s[after.ids.index(name)]))
    return hardest


def _passes(before: Snapshot, after: Snapshot, s_m: float) -> int:
    """Return how many vehicles besides the ego pass the position ``s_m`` within a decision."""
    behind = {name for name, at in zip(before.ids, before.s_m, strict=True) if at < s_m}
    ahead = {name for name, at in zip(after.ids, after.s_m, strict=True) if at >= s_m}
    return len((behind & ahead) - {"ego"})


def interval(successes: int, trials: int) -> str:
    """Return the share of successes in percent as text, with Wilson's interval at 95 %."""
    z, share = 1.96, successes / trials
    middle = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2))
    half /= 1 + z * z / trials
    return f"{share:.1%} ({max(middle - half, 0.0):.1%} to {min(middle + half, 1.0):.1%})"


def line(name: str, flow: float, merges: Sequence[Merge]) -> str:
    """Return the line of text on all episodes of one driver at one flow."""
    n = len(merges)
    made = [merge.decisions for merge in merges if merge.decisions is not None]
    return (
        f"{name}, {flow:g} vehicles/h/lane asked, "
        f"{sum(merge.flow_per_h for merge in merges) / n:.0f} found: {n} episodes, "
        f"merged {interval(sum(merge.merged for merge in merges), n)}, "
        f"ego hits {sum(merge.ego_hit for merge in merges)}, "
        f"hit by others {sum(merge.was_hit for merge in merges)}, "
        f"waited {interval(sum(merge.waits > 0 for merge in merges), n)}, "
        f"longest wait {max(merge.waits for merge in merges)} s, "
        f"on the highway after {sum(made) / max(len(made), 1):.1f} s, "
        f"forced braking {interval(sum(merge.forced for merge in merges), n)}"
    )


def main() -> int:
    """Drive each driver at each flow and print its line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--episodes", type=int, default=100, help="a line (default: 100)")
    parser.add_argument("--driver", nargs="+", default=["gap-mobil"], metavar="NAME")
    parser.add_argument("--flow", nargs="+", type=float, default=FLOWS, metavar="VEHICLES_PER_H")
    parser.add_argument("--safety-check", default="strict", choices=CHECKS)
    parser.add_argument("--seed", type=int, default=SEEDS, help=f"first (default: {SEEDS})")
    options = parser.parse_args()
    hits, begun_s = 0, time.monotonic()
    config = Config().updated("safety", check=options.safety_check)
    with tempfile.TemporaryDirectory() as home:
        for flow in options.flow:
            folder = Path(home, f"merge_{flow:g}")
            write_scenario(folder, MergeDescription(flow_per_h=flow))
            own = config.updated("simulation", scenario=str(folder))
            with closing(HighwayEnv(config=own)) as env:
                for name in options.driver:
                    seeds = range(options.seed, options.seed + options.episodes)
                    merges = [drive(env, name, seed) for seed in seeds]
                    hits += sum(merge.ego_hit for merge in merges)
                    print(line(name, flow, merges), flush=True)
    print(made_by(time.monotonic() - begun_s))
    return 1 if hits else 0


if __name__ == "__main__":
    sys.exit(main())
