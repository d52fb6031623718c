"""Gains over baselines on the same traffic, paired by seed: worked by hand."""

import pytest
from drives import episode

from drl_av.env.metrics import EpisodeResult
from drl_av.errors import DrlAvError
from drl_av.evaluation.statistics import paired


def drives(driver: str, vehicles: int, **speeds_m_s: float) -> list[EpisodeResult]:
    return [episode(driver, int(s[1:]), v, vehicles=vehicles) for s, v in speeds_m_s.items()]


ROWS = [
    *drives("ours", 10, s0=30.0, s1=20.0, s2=10.0),
    *drives("idm", 10, s2=9.0, s0=28.0, s1=17.0),  # in another order than ours
    *drives("mobil", 10, s0=10.0, s1=20.0, s2=27.0),
    *drives("ours", 5, s0=30.0, s1=30.0),
    *drives("idm", 5, s0=30.0, s1=20.0),
    *drives("mobil", 5, s0=30.0, s1=28.0),
]


def test_differences_are_taken_seed_by_seed() -> None:
    gain = next(g for g in paired(ROWS, "ours", ["idm", "mobil"]) if g.vehicles == 10)
    # 2, 3 and 1: mean 2, standard error 1 / sqrt(3), t(0.975, 2) = 4.3027. Row by row it would be
    # 21, -8, -7; of two independent means the half-width would be above 20.
    assert (gain.baseline, gain.episodes) == ("idm", 3)
    assert gain.difference_m_s.value == pytest.approx(2)
    assert gain.difference_m_s.half_width == pytest.approx(4.3027 / 3**0.5, abs=1e-3)


def test_the_best_baseline_is_that_of_the_density() -> None:
    gains = paired(ROWS, "ours", ["idm", "mobil"])
    assert [(g.vehicles, g.baseline, g.best) for g in gains] == [
        (5, "idm", False),
        (5, "mobil", True),  # 29 against 25 m/s
        (10, "idm", False),
        (10, "mobil", True),  # 19 against 18 m/s
    ]
    assert gains[0].difference_m_s.value == 5


def test_drivers_that_did_not_drive_the_same_seeds_are_not_compared() -> None:
    with pytest.raises(DrlAvError, match="ours and idm did not drive the same traffic among 10"):
        paired([row for row in ROWS if (row.driver, row.seed) != ("idm", 2)], "ours", ["idm"])
    with pytest.raises(DrlAvError, match="ours and sumo did not drive"):
        paired(ROWS, "ours", ["sumo"])
    with pytest.raises(DrlAvError, match="idm drove seed 0 among 5 vehicles twice"):
        paired([*ROWS, episode("idm", 0, 1.0, vehicles=5)], "ours", ["idm"])
