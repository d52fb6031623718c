"""The smallest separation on the way, and the collision there: against a thousand looks."""

import numpy as np
import pytest

from drl_av.road.snapshot import Collision, CollisionKind
from verification.separation import first_collision, swept_separation

SIZES_M = (5.0, 1.8)


def test_the_smallest_separation_on_the_way_is_that_of_a_thousand_looks() -> None:
    rng = np.random.default_rng(3)
    starts, ends = (rng.uniform(-12, 12, (2, 400, 3)) for _ in range(2))
    least_m = swept_separation(tuple(starts), tuple(ends), *SIZES_M)
    looks_m = np.full(least_m.shape, np.inf)
    for share in np.linspace(0, 1, 1001):
        x_m, y_m = starts + share * (ends - starts)
        ahead_m = np.abs(x_m[:, 1:] - x_m[:, :1]) - 5.0
        beside_m = np.abs(y_m[:, 1:] - y_m[:, :1]) - 1.8
        looks_m = np.minimum(looks_m, np.maximum(ahead_m, beside_m))
    assert (least_m <= looks_m + 1e-9).all()
    assert least_m == pytest.approx(looks_m, abs=0.05)  # 48 m in a thousand looks
    assert (least_m < -0.1).sum() > 50


def test_where_the_separation_is_negative_there_is_a_first_collision() -> None:
    # the ego stands; the first one comes from 10 m behind at 12 m a step, the other from 8 m ahead
    starts = np.array([0.0, -10.0, 8.0]), np.zeros(3)
    ends = np.array([0.0, 2.0, 4.9]), np.zeros(3)
    met = first_collision(starts, ends, *SIZES_M)
    assert met == Collision(CollisionKind.HIT_FROM_BEHIND, "vehicle1")
    later = np.array([0.0, -4.9, 3.0]), np.zeros(3)  # 5.1 m a step: after 98 %, and after 60 %
    assert first_collision(starts, later, *SIZES_M).other == "vehicle2"
