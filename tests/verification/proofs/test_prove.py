"""The lemmas hold at the default settings, have cases, and refuse what they do not cover."""

import re
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
import z3

from drl_av.config import Config
from drl_av.safety.assumptions import AT_LEAST
from verification import prove as program
from verification.program import run_program
from verification.proofs import lemma as machine
from verification.proofs.argument import argument
from verification.proofs.following import decision_claims
from verification.proofs.lane_changes import is_over, places
from verification.proofs.lemma import Lemma, Problem, UndecidedError, counterexample
from verification.proofs.rounding import rounding_m
from verification.prove import LEMMAS, refuted

DEFAULTS = argument(Config())


def lines_of(settings: str, folder: Path, capsys: Any, monkeypatch: Any) -> tuple[int, Any]:
    """Status and output of the program for a TOML text."""
    file = folder / "settings.toml"
    file.write_text(settings)
    monkeypatch.setattr("sys.argv", ["prove", "--config", str(file)])
    with pytest.raises(SystemExit) as ended:
        run_program(program.main)
    return ended.value.code, capsys.readouterr()  # type: ignore[return-value]


def test_the_default_settings_are_proved_a_line_a_lemma_in_less_than_a_minute(
    tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    status, out = lines_of("", tmp_path, capsys, monkeypatch)
    lines = out.out.splitlines()
    assert (status, out.err) == (0, "")
    assert [line.split()[0] for line in lines] == [*(lemma.name for lemma in LEMMAS), "rounding"]
    for line in lines:
        assert re.fullmatch(r"[a-z-]+ +proved +\d+\.\d\d s  [A-Za-z].*\.", line)
    assert sum(float(line.split()[2]) for line in lines) < 60


@pytest.mark.parametrize("lemma", LEMMAS, ids=lambda lemma: lemma.name)
def test_no_lemma_holds_for_want_of_cases(lemma: Lemma) -> None:
    for claim in lemma.claims(DEFAULTS):
        assert counterexample(claim._replace(goal=z3.BoolVal(False))) is not None


@pytest.mark.parametrize(
    ("settings", "lemma"),
    [
        ("[strict]\nbraking_m_s2 = 3.9", "following"),
        ("[strict]\nclearance_m = 0.0", "rounding"),
        ("[strict]\nfollower_braking_m_s2 = 5.0", "hand-over"),
        # two seconds on the ego is at 1.9 m, on the line
        ("[ego]\nlane_change_duration_s = 4.0", "abort"),
    ],
)
def test_settings_that_the_argument_does_not_cover_are_refused_with_the_lemma_that_fails(
    settings: str, lemma: str, tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    only = [each for each in LEMMAS if each.name == lemma]
    monkeypatch.setattr(program, "LEMMAS", only)
    status, out = lines_of(settings, tmp_path, capsys, monkeypatch)
    assert status == 1
    assert f"\n{lemma} " in f"\n{out.out}"
    assert "REFUTED" in out.out
    message = f"These settings are not covered: the lemma {lemma} fails, for example at "
    assert [line.startswith(message) for line in out.err.splitlines()] == [True]


@pytest.mark.parametrize(
    ("section", "change", "lemmas"),
    [
        # bounds of real traffic
        ("strict", {"braking_m_s2": 9.0, "lateral_speed_m_s": 2.1}, "following lane-end abort"),
        # the vehicle behind takes steps of a tenth of a second
        ("simulation", {"step_length_s": 0.1}, "response hand-over"),
        # it accelerates less than the ego, which leaves it behind where its speed is the higher
        ("strict", {"acceleration_m_s2": 1.5}, "response"),
        # two seconds on its side is at 1.9 m: at the line, but not over it by LINE_M
        ("ego", {"lane_change_duration_s": 7.6}, "response"),
        # it may brake less after another vehicle has measured its acceleration and begun to cut in
        ("ego", {"longitudinal_reference": "acc"}, "cut-in"),
        ("ego", {"longitudinal_reference": "idm"}, "cut-in"),
        # a truck is wider than the ego
        ("traffic", {"truck_share": 0.1, "truck_width_m": 3.7}, "corridor abort"),
        # the ego passes the line between two decisions, but its centre does not
        ("ego", {"lane_change_duration_s": 3.0}, "abort"),
        ("ego", {"lane_change_duration_s": 4.4}, "abort"),
    ],
)
def test_settings_near_the_edge_of_the_argument_are_proved(
    section: str, change: dict[str, Any], lemmas: str
) -> None:
    numbers = argument(Config().updated(section, **change))
    for lemma in LEMMAS:
        if lemma.name in lemmas.split():
            assert refuted(lemma, numbers) is None


def test_the_steering_plant_is_refused_before_any_proof(
    tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    steering = '[ego]\nlateral_plant = "steering"'
    status, out = lines_of(steering, tmp_path, capsys, monkeypatch)
    assert (status, out.out) == (1, "")
    assert "the lemma corridor describes 'kinematic' alone" in out.err


def test_the_smallest_accepted_clearance_covers_rounding_where_it_is_largest() -> None:
    hard = Config().updated("simulation", step_length_s=1.0)
    hard = hard.updated("ego", hard_brake_m_s2=10.0, max_speed_m_s=60.0)
    hard = hard.updated("strict", braking_m_s2=20.0, follower_braking_m_s2=10.0)
    least_m = dict(row[:2] for row in AT_LEAST)["clearance_m"]
    # two nanometres of the floor times 20 m/s^2 times a second squared
    assert 4e-8 < rounding_m(hard, argument(hard)) < 5e-8 < least_m / 1000


def test_the_bodies_of_trucks_are_among_those_of_the_proof() -> None:
    assert DEFAULTS.widths_m == (Fraction("1.8"),)
    assert argument(Config().with_traffic("all")).widths_m == (Fraction("1.8"), Fraction("2.5"))


def test_a_decision_finds_the_ego_in_its_lane_at_0_and_at_1_s() -> None:
    # 0.76 m a second: its side is over the line at 1.9 m by more than a centimetre at 1.01 m
    assert places(DEFAULTS) == [0, Fraction(76, 100)]
    assert not is_over(Fraction(101, 100), DEFAULTS)
    assert is_over(Fraction(102, 100), DEFAULTS)


def test_what_z3_does_not_decide_is_no_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    # Fermat's last theorem for cubes, and a claim that is wrong
    p = Problem()
    n, m, k = (z3.FreshInt() for _ in range(3))
    p.assume(n > 2, m > 2, k > 2)
    hard, wrong = p.follows(n * n * n + m * m * m != k * k * k), p.follows(n > 3)
    monkeypatch.setattr(machine, "TIMEOUT_S", 1)
    with pytest.raises(UndecidedError, match="The lemma cubes stays open: Z3 neither proves nor"):
        refuted(Lemma("cubes", "", lambda _: iter([hard])), DEFAULTS)
    assert refuted(Lemma("cubes", "", lambda _: iter([hard, wrong])), DEFAULTS) is not None


def test_the_claims_on_a_decision_are_as_many_as_actions_times_steps() -> None:
    assert len(list(decision_claims(DEFAULTS))) == 4 * 2
