"""Searches for scenes in which a safety check lets the ego hit a vehicle that obeys the bounds.

    python -m verification.falsify                      # the envelope of the paper's check
    python -m verification.falsify --safety-check strict   # an adversary that learns
    python -m verification.falsify --safety-check strict --sumo   # random scenes in SUMO
    python -m verification.falsify --safety-check my_check:function --search   # a check of yours

The envelope is the share of starts that end in a collision with a scripted adversary, in the
simulator of ``adversary.py``. The program prints it by family of scenes, closing speed, integration
method and step length; explicit Euler with 1 s is the plant of the paper. Under ``strict``, and
with ``--search``, the program instead searches for collisions with CMA-ES, which chooses the start,
the motion of all other vehicles and the proposed actions of the ego. The search and ``--sumo`` have
three more families of scenes, on roads whose lanes begin and end. The adversary proposes the ego's
actions too, so that a check that withstands it does so around any driver. The exit status is 1 if
the ego hit something or was hit under ``strict`` or under a check of the user.
"""

import sys
import warnings
from itertools import pairwise, product
from typing import Any

import numpy as np

from drl_av.arrays import BoolArray
from drl_av.cli.options import int_at_least
from drl_av.config import Config
from drl_av.config.functions import is_factory
from drl_av.env.custom import custom_check
from drl_av.errors import ScenarioError
from drl_av.road.snapshot import Collision
from drl_av.safety import CHECKS, named_check
from drl_av.safety.check import SafetyCheck
from verification.adversary import BatchCheck, BatchStrict, Mover, one_by_one
from verification.euler import Integration
from verification.falsification import genes, orders, play, scripted
from verification.falsification import search as learn
from verification.families import CONSTANT_SPEED, FAMILIES, PLACED
from verification.open_families import OPEN_FAMILIES
from verification.program import Program, run_program

CLOSING_M_S = (0.0, 5.0, 10.0, 15.0, 20.0, 30.0)
PLANTS = (
    (1.0, Integration.EXPLICIT),
    *product((1.0, 0.5, 0.1), (Integration.EULER, Integration.BALLISTIC)),
)
"""Step length and integration; the first is the plant of the paper."""
ENVELOPE = FAMILIES | {"constant-speed": CONSTANT_SPEED}
SEARCHED = FAMILIES | OPEN_FAMILIES


def check_of(config: Config) -> BatchCheck:
    """Return the safety check that the config names, as a function of many scenes."""
    strict = config.safety.check == "strict"
    return BatchStrict(config) if strict else one_by_one(safety_check(config))


def safety_check(config: Config) -> SafetyCheck:
    """Return the safety check that the config names, also one of the user, ``module:function``."""
    name = config.safety.check
    return custom_check(name, config) if is_factory(name) else named_check(config)


def envelope(config: Config, names: list[str], scenes: int, seed: int) -> list[dict[str, Any]]:
    """Measure the share of starts that end in a collision, with the scripted adversaries.

    Returns one row for each family, plant and range of closing speed.
    """
    rows = []
    for name, (step_s, integration) in product(names, PLANTS):
        family, plant = ENVELOPE[name], config.updated("simulation", step_length_s=step_s)
        rng = np.random.default_rng(seed)
        world = family.start(rng.random((scenes, PLACED * family.others)), plant)
        closing = world.speed_m_s[:, 0] - world.speed_m_s[:, 1]
        closing = -closing if name == "overtaker" else closing
        commands = scripted(family, scenes)
        _, ended = play(world, commands, check_of(plant), Mover(plant, integration))
        key = {"family": name, "step_s": step_s, "integration": integration.value}
        for low, high in pairwise(CLOSING_M_S):
            inside = ended[(closing >= low) & (closing < high)]
            found = {"closing_m_s": f"{low:g}-{high:g}", "starts": len(inside)}
            shares = {"ego_hit": share(inside == 1), "was_hit": share(inside == 2)}
            rows.append(key | found | shares)
    return rows


def share(of: BoolArray) -> float | None:
    """Return the share of True values; None if the array is empty."""
    return float(of.mean()) if len(of) else None


def search(config: Config, names: list[str], scenes: int, seed: int) -> list[dict[str, Any]]:
    """Search each named family with CMA-ES; return one row of results for each family."""
    rows = []
    for name in names:
        tallies = learn(SEARCHED[name], config, check_of(config), Mover(config), scenes, seed)
        *counts, least_m = zip(*tallies, strict=True)
        row = zip(("scenes", "ego_hit", "was_hit"), map(sum, counts), strict=True)
        rows.append({"family": name, **dict(row), "least_separation_m": round(min(least_m), 4)})
        print(rows[-1], file=sys.stderr)
    return rows


def in_sumo(config: Config, names: list[str], scenes: int, seed: int) -> list[dict[str, Any]]:
    """Drive scenes with a random adversary in SUMO and in the simulator.

    Returns one row for each family, with the collisions and the deviation between the simulators.
    """
    from verification.in_sumo import SumoWorld

    rows = []
    for name in names:
        family, check, mover = SEARCHED[name], check_of(config), Mover(config)
        sumo, rng = SumoWorld(config, family.road_kind), np.random.default_rng(seed)
        ends: list[tuple[Collision | None, Collision | None, float]] = []
        while len(ends) < scenes:
            genome = rng.normal(size=(1, genes(family)))
            placing = 1 / (1 + np.exp(-1.7 * genome[:, : PLACED * family.others]))
            world = family.start(placing, config)
            try:
                ends.append(sumo.play(world, orders(genome, family, config), check, mover))
            except ScenarioError:
                continue  # two of the other vehicles would overlap at the start
        ego_hit = [hit.kind.ego_hit for hit, *_ in ends if hit is not None]
        row = {"family": name, "scenes": scenes, "ego_hit": sum(ego_hit)}
        row |= {"was_hit": len(ego_hit) - sum(ego_hit)}
        row |= {"unlike_the_equations": sum(hit != expected for hit, expected, _ in ends)}
        furthest_m = round(max(off_m for *_, off_m in ends), 6)
        rows.append(row | {"furthest_from_the_equations_m": furthest_m})
    return rows


def show(rows: list[dict[str, Any]]) -> None:
    """Print the rows as a table."""
    texts = [[*rows[0]], *([_text(value) for value in row.values()] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    for line in texts:
        print("  ".join(map(str.ljust, line, widths)))


def _text(value: Any) -> str:
    return "" if value is None else f"{value:.3f}" if isinstance(value, float) else str(value)


def main() -> int:
    parser = Program(__doc__)
    parser.checks(CHECKS, default="paper")
    parser.add_argument("--family", nargs="+", choices=ENVELOPE | SEARCHED, help="default: all")
    text = "for each family, rounded up to hundreds by a search (default: 1000; strict: 100000)"
    parser.add_argument("--scenes", type=int_at_least(1), help=text)
    parser.number("--seed", 0, low=0)
    how = parser.add_mutually_exclusive_group()
    text = "search under any check, without the envelope"
    how.add_argument("--search", action="store_true", help=text)
    how.add_argument("--sumo", action="store_true", help="drive random scenes in SUMO")
    arguments = parser.parse_args()
    check = arguments.safety_check
    config, strict = Config().updated("safety", check=check), check == "strict"
    scenes = arguments.scenes or (50 if arguments.sumo else 100_000 if strict else 1000)
    work = in_sumo if arguments.sumo else search if strict or arguments.search else envelope
    warnings.filterwarnings("ignore", module="cma")
    known = {envelope: ENVELOPE, in_sumo: SEARCHED, search: SEARCHED}[work]
    if unknown := set(arguments.family or ()) - set(known):
        parser.error(f"the family {unknown.pop()!r} is not among these: {', '.join(known)}")
    rows = work(config, arguments.family or list(known), scenes, arguments.seed)
    show(rows)
    print(parser.made_by())
    hit = any(row["ego_hit"] or row["was_hit"] for row in rows)
    return 1 if (strict or is_factory(check)) and hit else 0


if __name__ == "__main__":
    run_program(main)
