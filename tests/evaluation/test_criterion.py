"""Pass or fail beside rule-based drivers, by hand, and by the command line."""

from dataclasses import asdict, replace
from pathlib import Path

import pytest
from drives import episode

import drl_av
from drl_av.cli import main
from drl_av.env.metrics import EpisodeResult
from drl_av.errors import DrlAvError
from drl_av.evaluation import criterion as module
from drl_av.evaluation.criterion import judge
from drl_av.evaluation.criticality import CriticalityResult
from drl_av.evaluation.evaluate import Results

COMFORT = dict.fromkeys(set(CriticalityResult.__annotations__), 0)


def drives(driver: str, *speeds_m_s: float, **changed: object) -> list[EpisodeResult]:
    """Two episodes among each of as many numbers of vehicles as the speeds need."""
    return [
        episode(driver, index % 2, speed, vehicles=index // 2 * 5, decisions=100, **changed)
        for index, speed in enumerate(speeds_m_s)
    ]


RULES = [
    *drives("idm", 20.0, 20.0, 18.0, 18.0),
    *drives("sumo", 24.0, 22.0, 20.0, 18.0, hard_brakes=2),  # the fastest
    *drives("planner", 30.0, 30.0, 30.0, 30.0),  # judged, and no bar for the others
]
FASTER = (25.0, 23.0, 21.0, 19.5)
"""1, 1, 1 and 1.5 m/s faster than sumo: 1.125 +- 3.182 * 0.25 / 2 = 0.398."""


def test_two_evaluations_of_one_driver_are_not_judged_as_one() -> None:
    mine = drives("mine", *FASTER)
    with pytest.raises(DrlAvError, match=r"mine drove seed 0 among 0 vehicles twice: remove one"):
        judge([*mine, *mine[:1], *RULES])


def judged(rows: list[EpisodeResult]) -> dict[str, module.CriterionResult]:
    return {each.driver: each for each in judge([*rows, *RULES])}


def test_a_driver_passes_that_is_surely_faster_and_no_less_safe_or_comfortable() -> None:
    mine = judged(drives("mine", *FASTER, hard_brakes=2))["mine"]
    assert mine.passed
    assert mine.over == "sumo"
    assert mine.gain_m_s == pytest.approx((1.125, 0.398), abs=1e-3)
    # 8 hard brakes in 100 s at each speed
    assert mine.hard_brakes_per_km == pytest.approx(8 / 8.85)
    assert mine.their_hard_brakes_per_km == pytest.approx(8 / 8.4)
    assert str(mine).startswith("mine: PASS against sumo\n  gain in speed 1.12 ± 0.40 m/s\n")


def test_being_faster_by_chance_is_a_failure() -> None:
    # 4, 0, 1 and 0: mean 1.25, standard error 0.95
    mine = judged(drives("mine", 28.0, 22.0, 21.0, 18.0))["mine"]
    assert mine.failures == ("speed",)
    assert mine.gain_m_s.value == 1.25
    assert judged(drives("mine", 24.0, 22.0, 20.0, 18.0))["mine"].failures == ("speed",)


def test_hits_are_compared_with_the_rule_based_driver_that_hits_least() -> None:
    rows = drives("mine", *FASTER)
    rows[3] = replace(rows[3], collided=True, ego_hit=True)
    crashing = [
        replace(r, ego_hit=r.driver == "sumo" or (r.driver, r.seed, r.vehicles) == ("idm", 1, 5))
        for r in RULES
    ]
    assert judge([*rows, *RULES])[0].failures == ("collisions",)
    first = judge([*rows, *crashing])[0]
    assert (first.passed, first.ego_hits, first.fewest_ego_hits) == (True, 1, 1)
    rows[2] = replace(rows[2], ego_hit=True)
    assert judge([*rows, *crashing])[0].failures == ("collisions",)  # sumo hits in four
    was_hit = [replace(each, collided=True) for each in drives("mine", *FASTER)]
    assert judge([*was_hit, *RULES])[0].passed


def test_hard_brakes_are_compared_in_a_kilometre() -> None:
    assert judged(drives("mine", *FASTER, hard_brakes=3))["mine"].failures == ("comfort",)
    both = judged(drives("mine", 19.0, 19.0, 19.0, 19.0, hard_brakes=2))["mine"]
    assert both.failures == ("speed", "comfort")  # as many, on a shorter way


def comfortable(rows: list[EpisodeResult], decisions: int) -> list[EpisodeResult]:
    more = COMFORT | {"comfortable_decisions": decisions}
    return [CriticalityResult(**asdict(each) | more) for each in rows]  # type: ignore[arg-type]


def test_with_criticality_comfort_is_nuplan_s_share_too() -> None:
    mine, rules = drives("mine", *FASTER), comfortable(RULES, 90)
    assert judge([*comfortable(mine, 90), *rules])[0].passed
    worse = judge([*comfortable(mine, 89), *rules])[0]
    assert worse.failures == ("comfort",)
    assert (worse.comfortable_percent, worse.their_comfortable_percent) == (89.0, 90.0)
    assert str(worse).endswith("\n  comfortable decisions 89.0 % (90.0 %)")


def test_without_a_rule_based_driver_no_driver_is_judged_and_other_traffic_is_refused() -> None:
    assert judge(drives("mine", *FASTER)) == judge(drives("planner", *FASTER)) == []
    assert [each.driver for each in judge(RULES)] == ["planner"]
    with pytest.raises(DrlAvError, match="mine and sumo did not drive the same traffic"):
        judge([*drives("mine", *FASTER[:2]), *RULES])


def test_the_function_returns_the_judgements() -> None:
    rows = Results([*drives("mine", *FASTER), *RULES])
    assert next((each.driver, each.passed) for each in rows.judgements) == ("mine", True)
    settings = {"simulation": {"decisions_per_episode": 3}}
    found = drl_av.evaluate(["random", "planner"], vehicles=2, episodes=1, config=settings)
    assert [each.over for each in found.judgements] == ["random"]
    assert [each.driver for each in found] == ["random", "planner"]


@pytest.mark.parametrize(("needed", "status"), [([], 0), (["--require-pass"], 1)])
def test_the_command_ends_with_the_judgement_and_its_status_is_1_only_if_asked(
    needed: list[str], status: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "short.toml").write_text("[simulation]\ndecisions_per_episode = 3\n")
    words = ["evaluate", "pretrained", "idm", "--vehicles", "2", "--episodes", "1", *needed]
    assert main([*words, "--config", str(tmp_path / "short.toml")]) == status
    last = capsys.readouterr().out.split("pretrained: ")[-1]  # one episode is never sure
    assert last.startswith("FAIL (speed) against idm\n  gain in speed ")


def test_a_pass_is_not_required_if_none_is_judged(capsys: pytest.CaptureFixture[str]) -> None:
    for names in (["pretrained"], ["idm", "sumo"]):
        assert main(["evaluate", *names, "--require-pass"]) == 1
        assert f"the drivers are {', '.join(names)}: name one of each" in capsys.readouterr().err


def test_a_single_episode_has_no_interval_and_no_infinite_one_is_printed() -> None:
    mine, theirs = episode("mine", 1, 25.0), episode("sumo", 1, 24.0)
    [judgement] = judge([mine, theirs])
    assert judgement.failures == ("speed",)
    assert "  gain in speed 1.00 m/s; a single episode has no interval\n" in str(judgement)
