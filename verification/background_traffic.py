"""Searches for collisions within the background traffic, and measures how it drives.

    python -m verification.background_traffic --episodes 500
    python -m verification.background_traffic --vehicles 30 --mix calm paper --ego idm-mobil sumo

A mix is a kind of traffic, or the shares of the drivers finite-state, level 0, level 1 and level 2
(the rest is SUMO's IDM). The program prints one line for each driver of the ego and each mix. The
line gives episodes, decisions of vehicles, vehicles in a collision according to SUMO, pairs of
vehicles whose bodies overlap when they are swept through each SUMO step, mean speed, and lane
changes per vehicle and minute. Collisions of the ego do not count. Then it prints a line for each
kind of overlap, with the first episode in which this kind was found.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import product

from drl_av.config import TRAFFIC_PRESETS, Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import driving_config, find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ConfigError
from drl_av.road.road import CENTERED_M
from drl_av.road.snapshot import EGO_ID, Snapshot
from drl_av.simulation.population import DriverModel
from verification.auditor import touching
from verification.program import Program, run_program
from verification.traffic_tally import TrafficTally

SHARES = ("finite_state_share", "level_0_share", "level_1_share", "level_2_share")
"""The settings of a mix of drivers, in its order."""
SEEDS = 810_000


class SweptTally(TrafficTally):
    """A TrafficTally that also finds vehicles whose bodies touch within a SUMO step.

    It sweeps the bodies through the step. It does not count collisions of the ego.
    """

    def __init__(self, env: HighwayEnv) -> None:
        super().__init__(env)
        self.overlaps: list[tuple[str, str]] = []
        """The kind of each overlap, and where it was found; a pair counts once in an episode."""

    def drive(self, driver: Driver, seed: int, vehicles: int) -> None:
        """Drive an episode and add it to the statistics."""
        self._before: Snapshot | None = None
        self._pairs: set[tuple[str, str]] = set()
        self._episode = f"seed {seed}, {vehicles} vehicles"
        super().drive(driver, seed, vehicles)

    def after_step(self, shot: Snapshot) -> None:
        """Add the collisions and overlaps of one SUMO step; ``shot`` is the snapshot after it."""
        super().after_step(shot)
        before = self._before or self._env.scene.snapshot
        found = set(touching(before, shot, self._env.road)) - self._pairs
        for pair in sorted(found):
            if EGO_ID not in pair:
                met = f"{self._episode}, {shot.time_s:g} s, {pair[0]} and {pair[1]}"
                self.overlaps.append((self._meeting(pair, shot), met))
        self._pairs |= found
        self._before = shot

    def _meeting(self, pair: tuple[str, str], shot: Snapshot) -> str:
        """Return the kind of an overlap: the two drivers, and if both are centred in a lane."""
        rows, road = [shot.ids.index(name) for name in pair], self._env.road
        models = self._env.simulation.fleet.driver_models
        drivers = sorted(DriverModel(models[row]).name.lower() for row in rows)
        off_m = [abs(y_m - road.center_m(road.lane_of(y_m))) for y_m in shot.y_m[rows]]
        where = "between lanes" if max(off_m) > CENTERED_M else "in one lane"
        return f"{' and '.join(drivers)}, {where}"

    def lines(self) -> Iterator[str]:
        """Yield a line for each kind of overlap: how often it occurs, and its first episode."""
        for meeting, times in sorted(Counter(how for how, _ in self.overlaps).items()):
            first = next(where for how, where in self.overlaps if how == meeting)
            yield f"{meeting}: {times} pairs, first in {first}"


def check(config: Config, ego: str, episodes: int, vehicles: Sequence[int]) -> SweptTally:
    """Drive episodes, and return their statistics.

    The episodes have the numbers of ``vehicles`` in turn. ``ego`` is the name of the ego's driver
    in ``drivers.registry``.
    """
    specs = find_drivers([ego])
    [driver] = make_drivers(specs, driving_config(specs, config)).values()
    with closing(HighwayEnv(config=config)) as env:
        tally = SweptTally(env)
        for episode in range(episodes):
            tally.drive(driver, SEEDS + episode, vehicles[episode % len(vehicles)])
    return tally


def with_mix(mix: str) -> Config:
    """Return the default config with a mix: a kind of traffic, or shares as ``FSM,L0,L1,L2``.

    Raises:
        ConfigError: ``mix`` is neither, or the shares are above 1 in total.
    """
    if mix in TRAFFIC_PRESETS:
        return Config().with_traffic(mix)
    try:
        shares = dict(zip(SHARES, map(float, mix.split(",")), strict=True))
    except ValueError:
        raise ConfigError(
            f"The mix is {mix!r}, but must be one of {', '.join(TRAFFIC_PRESETS)}, or four shares "
            "as in 0.2,0.3,0.3,0.2: finite-state, level 0, level 1 and level 2."
        ) from None
    return Config().updated("traffic", **shares)


def main() -> None:
    """Drive each mix and print its results."""
    parser = Program(__doc__)
    parser.number("--episodes", 500, "for each mix and driver")
    parser.numbers("--vehicles", range(1, 31), "beside the ego, in turn")
    kinds = [*TRAFFIC_PRESETS]
    parser.add_argument("--mix", nargs="+", default=kinds, help="default: each kind of traffic")
    parser.drivers("sumo", name="--ego")
    options = parser.parse_args()
    for ego, mix in product(options.ego, options.mix):
        tally = check(with_mix(mix), ego, options.episodes, options.vehicles)
        print(
            f"{ego}, {mix}: {options.episodes} episodes, {tally.vehicle_decisions} "
            f"vehicle-decisions, {tally.colliding} collisions, {len(tally.overlaps)} overlaps, "
            f"{tally.mean_speed_m_s:.2f} m/s, {tally.lane_changes_a_minute:.2f} lane changes "
            "a vehicle and minute",
            *tally.lines(),
            sep="\n  ",
            flush=True,
        )
    print(parser.made_by())


if __name__ == "__main__":
    run_program(main)
