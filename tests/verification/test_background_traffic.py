"""Collisions within the background traffic are found, and named by how the vehicles meet."""

import pytest

from drl_av.config import Config
from drl_av.errors import ConfigError
from verification import background_traffic
from verification.background_traffic import check, with_mix


@pytest.fixture(autouse=True)
def one_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The episode in which an IDM driver of acceleration 1.04 m/s² stops too late."""
    monkeypatch.setattr(background_traffic, "SEEDS", 810_029)


def test_idm_that_brakes_too_late_is_found_and_named_once() -> None:
    late = Config().with_traffic("calm").updated("traffic", keep_stopping_distance=False)
    tally = check(late, "sumo", 1, [30])
    assert tally.colliding == 2  # both vehicles, as SUMO reports them
    assert list(tally.lines()) == [
        "sumo and sumo, in one lane: 1 pairs, first in seed 810029, 30 vehicles, 176 s, "
        "vehicle10 and vehicle11"
    ]


@pytest.mark.parametrize("mix", ["clam", "0.5,0.5"])
def test_a_mix_that_is_none_is_refused(mix: str) -> None:
    with pytest.raises(ConfigError, match=r"but must be one of calm, .* or four shares"):
        with_mix(mix)


def test_with_a_stopping_distance_the_same_traffic_does_not_collide() -> None:
    tally = check(Config().with_traffic("calm"), "sumo", 1, [30])
    assert tally.colliding == 0
    assert tally.overlaps == []


def test_a_collision_of_the_ego_is_not_one_of_the_traffic() -> None:
    config = Config().updated("safety", check="permit_all")
    tally = check(config, "random", 1, [30])
    assert tally.vehicle_decisions < 200 * 30  # the ego hit something
    assert tally.overlaps == []
