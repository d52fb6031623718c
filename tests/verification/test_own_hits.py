"""The bound on the ego's own hits: tests in which a vehicle tries to change lanes towards it."""

import sys

import numpy as np
import pytest
from runs import Capsys

from drl_av.errors import ConfigError
from verification import crash_rate, own_hits
from verification.adversary import World
from verification.crash_simulation import SECONDS, settings
from verification.naturalistic import PEOPLE, Traffic, starts
from verification.own_hits import SHARE, Approaching, Keeping, hits, tries

MAINTAIN = 0


def test_tries_are_those_among_people_given_that_there_is_one() -> None:
    # nine vehicles, 27 s, 1.25e-3 a second: e^(-243 * 1.250782e-3) have none
    assert pytest.approx(1 - np.exp(-0.30394), abs=1e-5) == SHARE
    drawn = tries(100_000, np.random.default_rng(4))
    assert drawn.any(axis=1).all()
    # each second of each vehicle is as likely as another: 1.25e-3 / 0.2621
    often = [part.mean() for part in np.split(drawn, 3, axis=1)]
    assert often == pytest.approx([0.00477] * 3, rel=0.03)
    # given one, there is none after it as often as among people without it
    assert (drawn.sum(axis=1) == 1).mean() == pytest.approx(0.30394 * 0.7379 / 0.2621, rel=0.01)


def begun(people: type[Traffic], tests: int) -> tuple[int, int]:
    """Number of tests in which anybody begins a change towards the ego, or away from it.

    Nothing moves, so that the lanes that the vehicles start in say which one it is.
    """
    rng = np.random.default_rng(8)
    world = starts(tests, settings("real"), rng)
    traffic = people(world, PEOPLE, rng)
    lane = np.round(world.y_m / 3.8).astype(int)
    toward, away = np.zeros(tests, bool), np.zeros(tests, bool)
    for _ in range(SECONDS):
        traffic.decide(world, np.full(tests, MAINTAIN))
        sign = np.sign(traffic._target - lane[:, 1:])
        ego = np.sign(lane[:, :1] - lane[:, 1:])
        toward |= ((sign != 0) & (sign == ego)).any(axis=1)
        away |= ((sign != 0) & (sign != ego)).any(axis=1)
    assert (traffic.weights == 1.0).all()
    return int(toward.sum()), int(away.sum())


def test_a_vehicle_tries_in_each_test_or_in_none() -> None:
    among_people, away = begun(Traffic, 1500)
    approaching, away_too = begun(Approaching, 1500)
    keeping, still_away = begun(Keeping, 1500)
    # some vehicles that try have no room, and on one side of three lanes there is no ego
    assert 0 < among_people < 0.4 * approaching < 0.4 * 1500
    assert keeping == 0
    assert min(away, away_too, still_away) > 0.7 * max(away, away_too, still_away) > 50


def test_hits_count_for_the_share_of_the_tests_that_are_driven() -> None:
    # no hit in 1000: at most 1 - 0.025^(1 / 1000) of them with 97.5 % on that side
    none = hits(np.zeros(1000))
    assert none == (0.0, 0.0, pytest.approx(SHARE * 0.0036821, rel=1e-4))
    # Clopper and Pearson for 2 of 1000: 0.000242 to 0.007206
    two = hits(np.array([1.0, 1.0] + [0.0] * 998))
    assert two == pytest.approx((SHARE * 0.002, SHARE * 0.000242, SHARE * 0.007206), rel=2e-3)


class Wall(Keeping):
    """No vehicle tries, and yet one stands in front of the ego, which the proof excludes."""

    def decide(self, world: World, proposal: np.ndarray):  # type: ignore[no-untyped-def, type-arg]
        world.x_m[:, 1], world.y_m[:, 1] = world.x_m[:, 0] + 5.01, world.y_m[:, 0]
        world.speed_m_s[:, 1] = 0.0
        return super().decide(world, proposal)


@pytest.mark.parametrize(("people", "status"), [(Keeping, 0), (Wall, 1)])
def test_the_control_can_fail(
    people: type[Traffic], status: int, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setattr(own_hits, "Keeping", people)
    words = ["--tests", "2", "--control", "3", "--careless", "0.01", "--seed", "99"]
    monkeypatch.setattr(sys, "argv", ["own_hits", *words])
    assert own_hits.main() == status
    out = capsys.readouterr().out
    assert "strict, bounds of real traffic: 2 tests of 0." in out
    control = "control: 3 tests in which no vehicle tries, the ego hits a vehicle"
    assert f"{control} {3 * status} times" in out


def test_a_driver_that_cannot_be_tested_is_refused_before_the_first_test(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    for program in (own_hits, crash_rate):
        monkeypatch.setattr("sys.argv", ["program", "--tests", "2", "--driver", "idm", "planner"])
        with pytest.raises(ConfigError, match="The planner searches on a loop, not in these tests"):
            program.main()
        assert capsys.readouterr().out == ""


@pytest.mark.parametrize("share", ["0", "1", "1.5"])
def test_a_share_of_careless_lane_changes_is_between_0_and_1(
    share: str, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["own_hits", "--careless", share])
    with pytest.raises(SystemExit, match="2"):
        own_hits.main()
    assert f"argument --careless: {share} is not between 0 and 1" in capsys.readouterr().err
