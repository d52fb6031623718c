"""The smallest separation on the way: against a thousand looks."""

import numpy as np
import pytest

from verification.separation import swept_separation

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
