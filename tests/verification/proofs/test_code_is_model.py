"""What Z3 proves of the model holds for the code: they are equal, on a million random states."""

from dataclasses import fields, replace
from fractions import Fraction
from functools import reduce
from math import ceil, floor
from typing import Any

import numpy as np
import pytest
import z3
from hypothesis import given, settings
from hypothesis import strategies as st

from drl_av.arrays import FloatArray
from drl_av.compiled import compiled
from drl_av.config import Config, StrictConfig
from drl_av.driving.actions import Longitudinal, ego_numbers
from drl_av.safety import reachability, strict
from drl_av.safety.reachability import accelerated, lateral_extent, required_travel, stopping_limit
from verification.proofs import lateral, motion
from verification.proofs.argument import argument
from verification.proofs.followers import seconds_to_line
from verification.proofs.lemma import Problem
from verification.proofs.rounding import rounding_m

CONFIG = Config()
EXACT = argument(CONFIG)
BOUND_M = rounding_m(CONFIG, EXACT)
FRACTIONS = [item.name for item in fields(EXACT) if type(getattr(EXACT, item.name)) is Fraction]
IN_FLOATS: Any = replace(EXACT, **{name: float(getattr(EXACT, name)) for name in FRACTIONS})
"""The numbers of the model, so that it runs on arrays."""


def largest_of_arrays(terms: Any) -> Any:
    return reduce(np.maximum, terms)


def test_the_closed_forms_are_the_pieces_of_the_model_on_a_million_states() -> None:
    rng, a, sim = np.random.default_rng(5), IN_FLOATS, CONFIG.simulation
    bounds = CONFIG.strict.numbers
    for _ in range(50):
        ego, other = 30 * rng.random(20_000), 60 * rng.random(20_000)
        ego[::7], other[::7] = np.round(ego[::7]), np.round(other[::7])  # where pieces meet
        gap_m = 250 * rng.random(20_000) + 1e-3
        rolled_m = motion.stopping(largest_of_arrays, other, 4.5, 60.0, 0.5)
        assert close(reachability.stopping_distance(other, 4.5, 0.5), rolled_m)
        ahead_m = limits(gap_m, other, bounds)
        rest_m = gap_m + motion.lead_stops(largest_of_arrays, other, a)
        assert close(ahead_m, rest_m - a.clearance_m)
        for how in Longitudinal:
            rate = how.acceleration_m_s2(CONFIG.ego)
            reach_m = reachability.reach(ego, rate, CONFIG.ego, sim)
            assert close(reach_m, motion.reach(largest_of_arrays, ego, rate, a.steps, a))
            needed_m = reachability.cut_in_gap(ego, rate, other, CONFIG.strict, CONFIG.ego, sim)
            other_m = motion.lead_stops(largest_of_arrays, other, a)
            model_m = motion.cut_in_gap(largest_of_arrays, ego, rate, other_m, a)
            assert close(needed_m, model_m)
        for time_s in (0.5, 1.0):
            rolled_m = accelerated(other, time_s, bounds, 0.5)
            assert close(rolled_m, motion.accelerated(other, time_s, a))
        for delay_s in (0.5, 1.0, 1.5):
            must_m = travels(gap_m, other, delay_s, bounds)
            model_m = motion.must_reach(largest_of_arrays, gap_m, other, delay_s, a)
            assert close(must_m, model_m)


@compiled
def limits(gap_m: FloatArray, speed_m_s: FloatArray, bounds: StrictConfig) -> FloatArray:
    """``stopping_limit`` of many vehicles ahead."""
    found = np.empty(len(gap_m))
    for row in range(len(gap_m)):
        found[row] = stopping_limit(gap_m[row], True, speed_m_s[row], bounds, 0.5)
    return found


@compiled
def travels(
    gap_m: FloatArray, speed_m_s: FloatArray, delay_s: float, bounds: StrictConfig
) -> FloatArray:
    """``required_travel`` of many vehicles behind."""
    found = np.empty(len(gap_m))
    for row in range(len(gap_m)):
        found[row] = required_travel(gap_m[row], False, speed_m_s[row], delay_s, bounds, 0.5)
    return found


def close(code: Any, model: Any) -> bool:
    return bool(np.abs(code - model).max() < float(BOUND_M))


speeds = st.one_of(st.floats(0, 30), st.integers(0, 60).map(lambda half: half / 2))


@given(speeds, speeds, st.floats(0.001, 250), st.sampled_from(Longitudinal))
@settings(max_examples=300, deadline=None)
def test_rounding_is_within_its_bound(
    ego: float, other: float, gap_m: float, how: Longitudinal
) -> None:
    rate = how.acceleration_m_s2(CONFIG.ego)
    reach_m = reachability.reach(ego, rate, CONFIG.ego, CONFIG.simulation)
    ahead_m = stopping_limit(gap_m, True, other, CONFIG.strict, 0.5)
    speed, rest = Fraction(ego), Fraction(other)
    exact_m = motion.reach(max, speed, Fraction(rate), EXACT.steps, EXACT)
    exact_m -= Fraction(gap_m) + motion.lead_stops(max, rest, EXACT) - EXACT.clearance_m
    off_m = abs(Fraction(float(reach_m)) - Fraction(float(ahead_m)) - exact_m)
    assert off_m < BOUND_M < EXACT.clearance_m


def test_the_bound_on_rounding_is_no_larger_than_what_the_check_reads_is_off() -> None:
    # a nanometre of the gap, two of the floor; rounding itself is a thousandth of that
    assert 2e-9 < BOUND_M < 4e-9


# Across the road


def value(p: Problem, *terms: Any) -> list[float]:
    """The numbers that a problem leaves for some terms, of which there is one each."""
    solver = z3.Solver()
    solver.add(*p.follows().known)
    assert solver.check() == z3.sat
    return [float(Fraction(str(solver.model().eval(term)))) for term in terms]


thousandths = st.integers(0, 3800).filter(lambda n: min(abs(n % 10 - 5), 5) > 0)


@given(thousandths, st.sampled_from([-1, 1]), st.booleans())
@settings(max_examples=40, deadline=None)
def test_the_corridor_is_the_model_s(thousandth: int, side: int, comes_back: bool) -> None:
    y_m = side * Fraction(thousandth, 1000)
    end, sign = (0, -side) if comes_back else (side, side)
    p = Problem()
    way = lateral.corridor(p, z3.RealVal(y_m), end, sign, EXACT)
    # the model's lane 0 is the code's lane 1
    change, ego = (1 + end - sign, 1 + end), ego_numbers(CONFIG.ego, CONFIG.simulation)
    right_m, left_m = strict.corridor(3.8 + float(y_m), 1.8, change, 3.8, ego)
    assert value(p, *way) == pytest.approx([right_m - 3.8, left_m - 3.8])


def extents(thousandth: int, toward: int) -> tuple[list[float], list[float]]:
    """Return the extent of a body by the model and by the code, right and left end."""
    p, y_m = Problem(), Fraction(thousandth, 1000)
    ends = lateral.extent(p, z3.RealVal(y_m), toward, EXACT)
    return value(p, *ends), [*lateral_extent(float(y_m), 0.76 * toward, 1.8, 3.8)]


# The line is at 1.9 m. A body of 1.8 m at 1.01 or 2.79 m is over it by exactly LINE_M, 0.01 m.
EXACTLY_OVER = 1010, 2790


@given(thousandths.filter(lambda n: n not in EXACTLY_OVER), st.sampled_from([-1, 0, 1]))
@settings(max_examples=40, deadline=None)
def test_the_extent_of_a_vehicle_is_the_model_s(thousandth: int, toward: int) -> None:
    model, code = extents(thousandth, toward)
    assert model == pytest.approx(code)


@pytest.mark.parametrize("toward", [-1, 0, 1])
@pytest.mark.parametrize("thousandth", EXACTLY_OVER)
def test_where_rounding_decides_the_extent_it_is_the_model_s_or_a_wider_one(
    thousandth: int, toward: int
) -> None:
    (right_m, left_m), code = extents(thousandth, toward)
    assert code[0] <= right_m + 1e-9
    assert code[1] >= left_m - 1e-9


@pytest.mark.parametrize("duration_s", [2.5, 4.7, 5.0, 6.3, 7.6, 9.1])
def test_the_time_to_the_line_is_the_model_s(duration_s: float) -> None:
    config = CONFIG.updated("ego", lane_change_duration_s=duration_s)
    a = argument(config)
    for k in range(ceil(duration_s)):
        y_m = k * a.stride_m
        to_line_m = 3.8 / 2 - float(y_m) - 1.8 / 2
        ego = ego_numbers(config.ego, config.simulation)
        assert strict.seconds_to_line(to_line_m, 3.8, ego) == seconds_to_line(y_m, a)


def test_the_exact_model_floors_as_the_code_does_where_pieces_meet() -> None:
    # 10 m/s is five steps of braking at 4 m/s^2: 8 + 6 + 4 + 2 m/s for half a second each
    for speed in (10, Fraction(10) - Fraction(1, 10**15)):
        assert floor(motion.ego_stops(max, Fraction(speed), EXACT) + Fraction(1, 10**9)) == 10
