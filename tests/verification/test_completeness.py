"""Safe actions that the check refuses, as against unsafe ones.

At 20 m/s maintain reaches 65 m, and one ahead at 20 m/s that brakes rolls 45 m: at a gap of more
than 20 m the ego stops behind it, and the check keeps 0.5 m of that distance.
"""

import numpy as np
import pytest

from drl_av.config import Config
from verification.adversary import LENGTH_M, BatchStrict, World
from verification.completeness import Refusals, measured, refusals, safe, visited
from verification.families import FAMILIES, placed

STRICT = Config().updated("safety", check="strict")
MAINTAIN, ACCELERATE, MAINTAIN_LEFT = 0, 1, 8
ADVERSARIES = 20


def ahead(gap_m: float, lane: int, speed: float) -> World:
    """The ego in the right lane at 20 m/s, and one ahead."""
    zero, x_m = np.zeros(1, dtype=np.int64), np.array([[LENGTH_M + gap_m]])
    return placed(zero, np.array([20.0]), x_m, np.array([[lane]]), np.array([[speed]]))


def verdicts(world: World) -> dict[int, bool]:
    """The actions refused, and whether they are safe."""
    pairs, found = refusals(world, BatchStrict(STRICT))
    assert found.all()
    is_safe = safe(pairs, STRICT, ADVERSARIES, 0)
    return dict(zip(pairs.proposal.tolist(), is_safe.tolist(), strict=True))


@pytest.mark.parametrize(("gap_m", "is_safe"), [(20.3, True), (19.7, False)])
def test_an_acceleration_refused_within_the_clearance_is_safe(gap_m: float, is_safe: bool) -> None:
    refused = verdicts(ahead(gap_m, 0, 20.0))
    assert refused[MAINTAIN] is is_safe
    assert not refused[ACCELERATE]  # reaches 76.5 m


@pytest.mark.parametrize(("gap_m", "is_safe"), [(55.3, True), (54.7, False)])
def test_a_lane_change_refused_within_the_clearance_is_safe(gap_m: float, is_safe: bool) -> None:
    # one at 10 m/s in the next lane rolls 10 m; it is met once the ego's body is over the line
    assert verdicts(ahead(gap_m, 1, 10.0))[MAINTAIN_LEFT] is is_safe


def test_what_the_check_permits_is_not_among_its_refusals() -> None:
    # 32.01 m are enough for every acceleration, and there is no lane on the right
    assert verdicts(ahead(32.01, 0, 20.0)) == {}


@pytest.mark.parametrize("name", FAMILIES)
def test_no_state_is_without_a_permitted_action(name: str) -> None:
    row = measured(name, STRICT, 5, 3, 1)
    assert row["states"] == 5 * 14
    assert row["without_action"] == 0


def test_what_the_check_permits_is_safe() -> None:
    world, judge = visited(FAMILIES["overtaker"], STRICT, 20, 3), BatchStrict(STRICT)
    for number in (ACCELERATE, MAINTAIN_LEFT):
        proposal = np.full(len(world.x_m), number)
        permitted = np.flatnonzero(judge(world, proposal) == proposal)
        assert len(permitted) > 20
        kept = np.zeros(len(world.x_m), dtype=np.bool_)  # the check answers what comes next
        pairs = Refusals(world, proposal, kept).at(permitted)
        assert safe(pairs, STRICT, ADVERSARIES, 0).all()
