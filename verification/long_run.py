"""Runs the random driver under ``strict`` for a million decisions, and explains each collision.

    python -m verification.long_run --episodes 5000 --out long_run.csv
    python -m verification.long_run --episodes 200 --traffic naturalistic --out naturalistic.csv

Each episode appends a row to the table. After an interruption, the same command continues.
``--first`` and ``--episodes`` select episodes, to divide the work. The exit status is 1 if the ego
hit something, if a vehicle that broke no bound hit the ego, or if a broken bound has no known
cause.
"""

from collections import Counter
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.config import TRAFFIC_PRESETS, Config
from drl_av.drivers.rule_based import RandomDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics
from drl_av.env.rollout import rollout
from drl_av.evaluation.provenance import provenance, read_provenance, write_provenance
from drl_av.evaluation.statistics import grouped
from drl_av.evaluation.table import settings_mismatch, stored_config
from drl_av.files.table import append_rows, read_table
from drl_av.simulation.population import DriverModel
from verification.auditor import BETWEEN, BRAKES, LEAVES, SOONER, THROUGH, Auditor, Breach
from verification.program import Program, run_program

FIRST_SEED = 800_000
SHARES = ("finite_state_share", "level_0_share", "level_1_share")
MIXES: dict[str, dict[str, float]] = {
    "sumo": {},
    **{name.removesuffix("_share"): {name: 1.0} for name in SHARES},
    "finite_state+level_0+level_1": dict.fromkeys(SHARES, 0.25),
}
"""Shares of the drivers in each mix of the traffic; the rest is SUMO's IDM."""
COLUMNS = (
    *("seed", "vehicles", "mix", "decisions", "mean_speed_m_s"),
    *("ego_hit", "collision", "other", "broken_bounds", "breaches", "all_breaches"),
    *("cut_ins", "least_cut_in_margin_m"),
)
UNKNOWN = "no known cause"
CAUSES = {
    BRAKES: "SUMO's IDM, which limits every driver, keeps a time gap and no stopping distance, and "
    "brakes too late behind an ego that brakes",
    LEAVES: "SUMO lets a vehicle that changes to another lane come nearer than it can stop",
    BETWEEN: "SUMO resumes or turns round a lane change that was cut short",
    THROUGH: "SUMO lets a vehicle that returns to its lane go on into the next one",
    SOONER: "its driver decided on the positions a SUMO step sooner, when it was right",
}
"""The cause of a breach, by its circumstance."""
APPROACH_S = 2.0
"""Two breaches of a vehicle belong to different approaches if more time lies between them."""
BLAME_S = 10.0
"""A breach explains a collision that follows within this time."""


class Watched(RandomDriver):
    """An environment whose SUMO steps an auditor watches; a random driver drives the ego."""

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.env = HighwayEnv(config=config)
        self.auditor = Auditor(config, self.env.road)
        self.env.simulation.after_step = self.auditor.watch

    def start(self, seed: int) -> None:
        """Prepare the driver and the auditor for an episode."""
        super().start(seed)
        self.auditor.start()
        self.auditor.watch(self.env.scene.snapshot)

    def episode(self, mix: str, seed: int) -> dict[str, Any]:
        """Drive the episode of a traffic seed, and return its row of the table."""
        metrics, vehicles = EpisodeMetrics(), 1 + seed % 30
        for decision in rollout(self.env, self, seed, vehicles):
            metrics.add(decision)
        result = metrics.result("random", self.env.check_name, vehicles, seed)
        margins, shot = self.auditor.cut_ins_m, self.env.scene.snapshot
        met = metrics.collision
        other = "" if met is None or met.other is None else met.other
        return {
            "seed": seed,
            "vehicles": result.vehicles,
            "mix": mix,
            "decisions": result.decisions,
            "mean_speed_m_s": round(result.mean_speed_m_s, 4),
            "ego_hit": result.ego_hit,
            "collision": result.collision,
            "other": other,
            "broken_bounds": self.auditor.explain(other, shot.time_s - BLAME_S) if other else "",
            "breaches": len(self.auditor.breaches),
            "all_breaches": "; ".join(self._worded(breach) for breach in self.auditor.breaches),
            "cut_ins": len(margins),
            "least_cut_in_margin_m": round(min(margins), 3) if margins else "",
        }

    def _worded(self, breach: Breach) -> str:
        fleet = self.env.simulation.fleet
        driver = DriverModel(fleet.driver_models[fleet.ids.index(breach.vehicle)]).name.lower()
        facts = breach.bound, driver, breach.vehicle, f"{breach.time_s:g}", breach.circumstance
        return "|".join(facts)


def main() -> int:
    parser = Program(__doc__)
    parser.number("--episodes", 5000, "number of episodes")
    parser.number("--first", 0, "number of the first episode", low=0)
    parser.add_argument("--traffic", choices=TRAFFIC_PRESETS, help="default: five mixes")
    parser.add_argument("--out", type=Path, default="long_run.csv", help="default: long_run.csv")
    arguments = parser.parse_args()
    base = Config().with_traffic("calm").updated("safety", check="strict")
    if arguments.traffic is not None:
        base = base.with_traffic(arguments.traffic)
        worlds = {arguments.traffic: Watched(base)}
    else:
        mixes = MIXES.items()
        worlds = {name: Watched(base.updated("traffic", **shares)) for name, shares in mixes}
    names = list(worlds)
    done, facts = read_table(arguments.out, growing=True), read_provenance(arguments.out)
    if facts and not (
        facts.get("mixes") == names and stored_config(facts["settings"], str(arguments.out)) == base
    ):
        raise settings_mismatch(arguments.out, arguments.out.with_suffix(".json"), "settings")
    spent_s = facts.get("wall_time_s", 0.0)
    made: dict[str, Any] = {"settings": asdict(base), "mixes": names}
    if not facts:
        write_provenance(arguments.out, provenance(base, **made))
    known = {int(row["seed"]) for row in done}
    try:
        for number in range(arguments.first, arguments.first + arguments.episodes):
            seed, mix = FIRST_SEED + number, names[number // 30 % len(names)]
            if seed not in known:
                append_rows(arguments.out, COLUMNS, [worlds[mix].episode(mix, seed)])
    finally:
        made["wall_time_s"] = spent_s + round(parser.spent_s(), 1)
        write_provenance(arguments.out, provenance(base, **made))
    status = report(read_table(arguments.out, growing=True))
    print(parser.made_by(spent_s))
    return status


def report(rows: list[dict[str, str]]) -> int:
    """Print a summary of the rows, and return the exit status.

    The status is 1 if the ego hit something, or if a collision or a breach has no explanation, and
    otherwise 0.
    """
    decisions = sum(int(row["decisions"]) for row in rows)
    margins = [float(row["least_cut_in_margin_m"]) for row in rows if row["least_cut_in_margin_m"]]
    hits = [row for row in rows if row["ego_hit"] == "True"]
    hit_by = [row for row in rows if row["collision"] and row["ego_hit"] != "True"]
    print(f"{len(rows)} episodes, {decisions} decisions, mixes {Counter(r['mix'] for r in rows)}")
    print(
        f"{sum(int(row['cut_ins']) for row in rows)} cut-ins ahead of the ego, "
        f"least margin {min(margins, default=float('nan')):.2f} m"
    )
    unexplained = report_breaches(rows)
    print(f"the ego hit something: {len(hits)}; it was hit: {len(hit_by)}")
    for row in hits + hit_by:
        print(
            f"  seed {row['seed']}, {row['vehicles']} vehicles, {row['mix']}: {row['collision']}, "
            f"{row['other']}: {row['broken_bounds'] or 'no bound broken'}"
        )
    return 1 if hits or unexplained or any(not row["broken_bounds"] for row in hit_by) else 0


class Approach(NamedTuple):
    """Consecutive breaches of one bound by one vehicle."""

    bound: str
    driver: str
    breaches: int
    circumstance: str
    """The circumstance of the first breach."""


def approaches(cell: str) -> list[Approach]:
    """Parse the approaches of an episode from its value in the column ``all_breaches``."""
    found: dict[tuple[str, str, str], list[tuple[float, str]]] = {}
    for words in filter(None, cell.split("; ")):
        bound, driver, vehicle, time_s, circumstance = words.split("|")
        found.setdefault((bound, driver, vehicle), []).append((float(time_s), circumstance))
    result = []
    for (bound, driver, _), moments in found.items():
        later = [
            n for n in range(1, len(moments)) if moments[n][0] - moments[n - 1][0] > APPROACH_S
        ]
        for start, end in pairwise([0, *later, len(moments)]):
            result.append(Approach(bound, driver, end - start, moments[start][1]))
    return result


def report_breaches(rows: list[dict[str, str]]) -> bool:
    """Print the number of breaches by cause; return whether a breach has no known cause."""
    every = [approach for row in rows for approach in approaches(row["all_breaches"])]
    episodes = sum(bool(row["all_breaches"]) for row in rows)
    print(f"bounds broken {sum(a.breaches for a in every)} times, in {episodes} episodes:")
    groups = grouped(
        every, lambda each: (each.bound, each.driver, CAUSES.get(each.circumstance, UNKNOWN))
    )
    for (bound, driver, cause), members in sorted(groups.items()):
        times = sum(each.breaches for each in members)
        print(f"  {bound}, {driver}: {times} times in {len(members)} approaches: {cause}")
    return any(cause == UNKNOWN for _, _, cause in groups)


if __name__ == "__main__":
    run_program(main)
