"""How drivers drive besides their speed: reversals, short headways, and what they do to others.

    python tools/measure_style.py --driver planner gap-mobil --vehicles 10 20 --episodes 10

A reversal is an acceleration after braking, or braking after an acceleration. A headway counts as
short below 1 s; it is that after a decision faster than 5 m/s. A forced braking is a decision in
which the vehicle behind a lane-changing ego brakes harder than 2 m/s^2.
"""

import argparse
from contextlib import closing

from drl_av.config import Config
from drl_av.drivers.registry import find_drivers, make_drivers
from drl_av.env.decision import Decision
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout

CHANGE_M_S = 0.3
"""A change of speed in a decision that counts as accelerating or braking."""
SHORT_HEADWAY_S = 1.0
CRAWLING_M_S = 5.0
FORCED_M_S2 = 2.0
FIRST_SEED = 860_000


class Style:
    """Counts over the decisions of some episodes."""

    def __init__(self) -> None:
        self.decisions = self.reversals = self.short_headways = self.forced_brakes = 0
        self.driven_km = 0.0
        self._sign = 0

    def begin(self) -> None:
        """Begin an episode."""
        self._sign = 0

    def add(self, decision: Decision) -> None:
        """Count a decision of one second."""
        before, after = decision.scene.affordances, decision.next_scene.affordances
        self.decisions += 1
        self.driven_km += after.ego_speed_m_s / 1000
        change = after.ego_speed_m_s - before.ego_speed_m_s
        sign = (change > CHANGE_M_S) - (change < -CHANGE_M_S)
        self.reversals += sign * self._sign < 0
        self._sign = sign or self._sign
        front, rear = after.own_front, after.own_rear
        if front is not None and after.ego_speed_m_s > CRAWLING_M_S:
            self.short_headways += front.gap_m < SHORT_HEADWAY_S * after.ego_speed_m_s
        scenes = decision.scene, decision.next_scene
        if rear is not None and any(scene.lane_change for scene in scenes):
            old, new = (float(scene.snapshot.speed_m_s[rear.vehicle]) for scene in scenes)
            self.forced_brakes += old - new > FORCED_M_S2

    def line(self, name: str) -> str:
        """Return the counts as a line of the table."""
        return (
            f"{name:<16}{self.reversals / self.driven_km:>16.2f}"
            f"{100 * self.short_headways / self.decisions:>16.2f}"
            f"{1000 * self.forced_brakes / self.decisions:>24.2f}"
        )


def main() -> None:
    """Drive the episodes and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--driver", nargs="+", required=True)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[5, 10, 15, 20, 25])
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--traffic", default="calm", metavar="KIND")
    parser.add_argument("--safety-check", default="paper")
    options = parser.parse_args()
    config = Config().with_traffic(options.traffic).updated("safety", check=options.safety_check)
    heads = f"{'reversals/km':>16}{'below 1 s, %':>16}{'forced/1000 decisions':>24}"
    print(f"{options.traffic}, {options.safety_check:<10}{heads}")
    with closing(HighwayEnv(config=config)) as env:
        for name, driver in make_drivers(find_drivers(options.driver), config).items():
            style = Style()
            for vehicles in options.vehicles:
                for seed in range(FIRST_SEED, FIRST_SEED + options.episodes):
                    style.begin()
                    for decision in rollout(env, driver, seed, vehicles):
                        style.add(decision)
            print(style.line(name), flush=True)


if __name__ == "__main__":
    main()
