"""Estimates how much faster the paper's own driver would be if ``strict`` refused fewer actions.

    python -m verification.sharper

An optimistic check is compared with ``strict`` in the same traffic, among the human drivers of
``naturalistic.py``. It permits each action that ``strict`` permits, and each other action after
which a search finds no collision, as in ``completeness.py``. The search misses some collisions, so
the optimistic check also permits some actions that no safe check with the same bounds can permit.
Its gain is therefore an upper bound of the gain of any such check, for this driver in this traffic.
The check ``nothing`` permits every action. For each check, under our bounds (``strict``) and those
of real traffic (``real``), the program prints the mean speed, the gain over ``strict`` in percent
with its 95 % interval, paired by test, and the collisions.
"""

from typing import Any

import numpy as np

from drl_av.arrays import IntArray
from drl_av.config import Config
from drl_av.evaluation.statistics import mean_with_interval
from verification.adversary import BatchCheck, BatchStrict, World
from verification.completeness import Refusals, on_road, rows_of, safe
from verification.crash_simulation import SECONDS, Outcome, drive, drivers, settings
from verification.falsify import show
from verification.naturalistic import PEOPLE, Traffic, starts
from verification.program import Program, run_program


class Optimist:
    """A BatchCheck that permits what ``strict`` permits, and what a search finds to be safe.

    Its arguments are the config, the number of adversaries of the search, and their seed.
    """

    def __init__(self, config: Config, adversaries: int, seed: int) -> None:
        self._config, self._search = config, (adversaries, seed)
        self._strict = BatchStrict(config)

    def __call__(self, world: World, proposal: IntArray) -> IntArray:
        """Return the executed action for each proposed action; both are 0 to 11, (scenes,)."""
        executed = self._strict(world, proposal)
        going = np.array([row not in world.collisions for row in range(len(proposal))])
        refused = np.flatnonzero((executed != proposal) & on_road(world, proposal) & going)
        if len(refused):
            is_maneuver = executed[refused] // 4 != proposal[refused] // 4
            pairs = Refusals(rows_of(world, refused), proposal[refused], is_maneuver)
            found = refused[safe(pairs, self._config, *self._search)]
            executed[found] = proposal[found]
        return executed


def nothing(world: World, proposal: IntArray) -> IntArray:
    """Return the proposed actions: the check that permits everything."""
    return proposal


def driven(config: Config, check: BatchCheck, tests: int, seed: int) -> Outcome:
    """Drive tests under a check, with starts that are safe under ``strict``; return the results.

    The same seed gives every check the same starts and the same random acts of the other vehicles.
    """
    rng = np.random.default_rng(seed)
    world = starts(tests, config, rng)
    egos = drivers("pretrained-paper", config, tests)
    return drive(config, world, Traffic(world, PEOPLE, rng), check, egos)


def compared(bounds: str, tests: int, adversaries: int, seed: int) -> list[dict[str, Any]]:
    """Compare the three checks with the bounds ``strict`` or ``real``; return a row for each."""
    config = settings(bounds)
    checks: dict[str, BatchCheck] = {
        "strict": BatchStrict(config),
        "optimist": Optimist(config, adversaries, seed),
        "nothing": nothing,
    }
    outcomes = {name: driven(config, check, tests, seed) for name, check in checks.items()}
    base = outcomes["strict"]
    return [row(bounds, name, found, base) for name, found in outcomes.items()]


def row(bounds: str, name: str, found: Outcome, base: Outcome) -> dict[str, Any]:
    """Return the row of one check; ``base`` are the same tests under ``strict``.

    The speed includes no test with a collision, which ends a test early, the gain none with one in
    either.
    """
    whole_tests, both = (each.ego_hit + each.was_hit == 0 for each in (found, base))
    both &= whole_tests
    gain = mean_with_interval(100 * (found.km - base.km)[both] / base.km[both].mean())
    return {
        **{"bounds": bounds, "check": name, "tests": len(base.km)},
        "mean_speed_m_s": f"{1000 * found.km[whole_tests].mean() / SECONDS:.2f}",
        "gain_percent": str(gain),
        **{"ego_hit": int(found.ego_hit.sum()), "was_hit": int(found.was_hit.sum())},
    }


def main() -> int:
    parser = Program(__doc__)
    parser.number("--tests", 120, "a check", low=2)
    parser.number("--adversaries", 18)
    parser.number("--seed", 2, low=0)
    options = parser.parse_args()
    sizes = options.tests, options.adversaries, options.seed
    show([each for bounds in ("strict", "real") for each in compared(bounds, *sizes)])
    print(parser.made_by())
    return 0


if __name__ == "__main__":
    run_program(main)
