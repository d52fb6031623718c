"""SUMO and the kinematic simulator report the same collisions of random approaches."""

import numpy as np
import pytest

from verification import approaches
from verification.approaches import APART_M, compare, start


@pytest.mark.parametrize("step_s", [1.0, 0.5, 0.25])
def test_sumo_and_the_simulator_agree_on_random_approaches(step_s: float) -> None:
    row = compare(step_s, 25, seed=11)
    assert row["collisions"] >= 3
    assert row["unlike_the_simulator"] == 0
    assert float(row["furthest_from_the_simulator_m"]) < APART_M


def test_a_disagreement_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    class Blind(approaches.SumoWorld):
        """SUMO in which no collision is reported."""

        def play(self, *scene):  # type: ignore[no-untyped-def]
            return None, *super().play(*scene)[1:]

    monkeypatch.setattr(approaches, "SumoWorld", Blind)
    row = compare(0.5, 25, seed=11)
    assert row["unlike_the_simulator"] >= 3
    assert row["collisions"] == 0


def test_no_approach_starts_with_bodies_that_touch() -> None:
    rng = np.random.default_rng(0)
    for _ in range(500):
        world = start(rng)
        along_m, across_m = np.abs(world.x_m[0] - 5000.0)[1], np.abs(np.diff(world.y_m[0]))[0]
        assert along_m > 5.0 or across_m >= 3.8
