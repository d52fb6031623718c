"""Pass, fail or undecided beside rule-based drivers, by hand, and by the command line."""

import json
from dataclasses import asdict, replace
from itertools import cycle
from pathlib import Path

import pytest
from drives import episode
from runs import Capsys

import drl_av
from drl_av.cli import main
from drl_av.env.metrics import EpisodeResult
from drl_av.errors import DrlAvError
from drl_av.evaluation import criterion as module
from drl_av.evaluation.criterion import judge, share_difference
from drl_av.evaluation.criticality import CriticalityResult
from drl_av.evaluation.evaluate import Results

COMFORT = dict.fromkeys(set(CriticalityResult.__annotations__), 0)


def drives(
    driver: str, *speeds_m_s: float, times: int = 1, **changed: object
) -> list[EpisodeResult]:
    """Two episodes among each of as many numbers of vehicles as the speeds need, of own seeds."""
    return [
        episode(driver, index, speed, vehicles=index // 2 * 5, decisions=100, **changed)
        for index, speed in enumerate(speeds_m_s * times)
    ]


def rules(times: int = 1) -> list[EpisodeResult]:
    return [
        *drives("idm", 20.0, 20.0, 18.0, 18.0, times=times),
        *drives("sumo", 24.0, 22.0, 20.0, 18.0, times=times, hard_brakes=2),  # the fastest
        *drives("pretrained", 30.0, 30.0, 30.0, 30.0, times=times),  # judged, no bar for others
    ]


RULES = rules()
FASTER = (25.0, 23.0, 21.0, 19.5)
"""1, 1, 1 and 1.5 m/s faster than sumo: 1.125 +- 3.182 * 0.25 / 2 = 0.398."""
ENOUGH = 50
"""With 4 * 50 episodes, 0 hits of 200 against 0 of 200 are decided: 3.84 / 203.84 is below 2 %."""


def test_two_evaluations_of_one_driver_are_not_judged_as_one() -> None:
    mine = drives("mine", *FASTER)
    with pytest.raises(DrlAvError, match=r"mine drove seed 0 among 0 vehicles twice: remove one"):
        judge([*mine, *mine[:1], *RULES])


def test_episodes_of_one_seed_among_several_numbers_of_vehicles_count_as_one() -> None:
    rows = [*drives("mine", *FASTER), *RULES]
    alike = [replace(row, seed=row.seed % 2) for row in rows]
    mine = {each.driver: each for each in judge(alike)}["mine"]
    # 1 and 1 of seed 0, 1 and 1.5 of seed 1: 1.125 +- 12.706 * 0.125, not 3.182 * 0.125
    assert mine.criterion("speed").difference == pytest.approx((1.125, -0.463, 2.713), abs=1e-3)
    assert mine.criterion("speed").result == "undecided"


def test_one_hit_more_than_the_safest_rule_is_no_pass_however_many_episodes() -> None:
    # 1 of 2000 against 0 of 2000: surely less than 2 % more, but more
    times = 500
    mine = drives("mine", *FASTER, times=times)
    mine[0] = replace(mine[0], collided=True, ego_hit=True)
    found = judged(mine, rules(times)).criterion("collisions")
    assert found.difference.high < 0.5
    assert found.result == "undecided"


def judged(rows: list[EpisodeResult], among: list[EpisodeResult]) -> module.CriterionResult:
    return {each.driver: each for each in judge([*rows, *among])}["mine"]


def test_a_driver_passes_that_is_surely_faster_and_no_less_safe_or_comfortable() -> None:
    mine = judged(drives("mine", *FASTER, times=ENOUGH, hard_brakes=1), rules(ENOUGH))
    assert (mine.passed, mine.over, mine.failures, mine.undecided) == (True, "sumo", (), ())
    assert str(mine).startswith("mine: PASS against sumo\n  speed: pass, 22.12 against")
    assert "\n  speed: pass, 22.12 against 21.00 m/s, +1.12 [1.0" in str(mine)
    brakes = mine.criterion("hard brakes")
    assert brakes.ours == pytest.approx(4 / 8.85)  # 4 in 100 s at each of the four speeds
    assert brakes.theirs == pytest.approx(8 / 8.4)
    assert brakes.difference.high < 0


def test_four_episodes_decide_speed_at_most() -> None:
    mine = judged(drives("mine", *FASTER), RULES)
    assert (mine.passed, mine.failures, mine.undecided) == (False, (), ("collisions",))
    gain = mine.criterion("speed").difference
    assert gain == pytest.approx((1.125, 1.125 - 0.398, 1.125 + 0.398), abs=1e-3)
    assert str(mine).startswith("mine: UNDECIDED against sumo\n")
    assert str(mine).endswith(
        "\n  in brackets: 95 % intervals of the differences; more episodes decide"
    )


def test_being_faster_by_chance_is_undecided_and_being_slower_is_a_failure() -> None:
    # 4, 0, 1 and 0: mean 1.25, standard error 0.95
    mine = judged(drives("mine", 28.0, 22.0, 21.0, 18.0), RULES)
    assert mine.criterion("speed").result == "undecided"
    assert mine.criterion("speed").difference.value == 1.25
    assert judged(drives("mine", 24.0, 22.0, 20.0, 18.0), RULES).failures == ("speed",)
    slower = judged(drives("mine", 23.0, 21.0, 19.0, 16.5), RULES)
    assert slower.criterion("speed").result == "fail"
    assert slower.criterion("speed").difference.high == pytest.approx(-1.125 + 0.398, abs=1e-3)


def test_the_interval_of_two_shares_is_that_of_newcombe() -> None:
    # Newcombe 1998, Statistics in Medicine 17:873, table II, method 10: (a) 56/70 - 48/80,
    # (b) 9/10 - 3/10, (e) 5/56 - 0/29, (h) 10/10 - 0/10
    for counts, low, high in (
        (((56, 70), (48, 80)), 0.0524, 0.3339),
        (((9, 10), (3, 10)), 0.1705, 0.8090),
        (((5, 56), (0, 29)), -0.0381, 0.1926),
        (((10, 10), (0, 10)), 0.6075, 1.0000),
    ):
        found = share_difference(*counts)
        assert (found.low, found.high) == pytest.approx((low, high), abs=1e-4)


def hitting(rows: list[EpisodeResult], number: int) -> list[EpisodeResult]:
    return [replace(row, ego_hit=place < number) for place, row in enumerate(rows)]


def test_hits_are_compared_with_the_rule_based_driver_that_hits_least() -> None:
    mine = drives("mine", *FASTER, times=ENOUGH)
    [idm, sumo] = ([row for row in rules(ENOUGH) if row.driver == name] for name in ("idm", "sumo"))
    for ours, theirs, result in (
        (0, 0, "pass"),
        (1, 0, "undecided"),
        (6, 0, "fail"),  # 3 % against less than 1.9 %
        (1, 1, "undecided"),
        (30, 2, "fail"),
        (0, 30, "pass"),
    ):
        among = [*hitting(idm, theirs), *hitting(sumo, 40)]  # sumo is faster, and hits more
        found = judged(hitting(mine, ours), among).criterion("collisions")
        assert (found.ours, found.theirs, found.over, found.result) == (ours, theirs, "idm", result)
    was_hit = [replace(each, collided=True) for each in mine]
    assert judged(was_hit, [*idm, *sumo]).criterion("collisions").result == "pass"


def test_hard_brakes_are_compared_in_a_kilometre_by_their_interval() -> None:
    results = {}
    for brakes in (0, 1, 2, 3, 4):
        mine = judged(drives("mine", *FASTER, times=ENOUGH, hard_brakes=brakes), rules(ENOUGH))
        results[brakes] = mine.criterion("hard brakes").result
    # as many on a longer way are fewer in a kilometre
    assert results == {0: "pass", 1: "pass", 2: "pass", 3: "fail", 4: "fail"}
    rows = drives("mine", *FASTER)
    rows[0] = replace(rows[0], hard_brakes=9)
    assert judged(rows, RULES).criterion("hard brakes").result == "undecided"


def test_a_hard_brake_in_a_short_episode_counts_as_one_of_all_kilometres() -> None:
    # 2 + 2 + 2 + 1 in 3 x 2 km and 20 m; the mean of the episodes' 1, 1, 1 and 50 a km is a decoy
    mine, idm = (drives(name, *[20.0] * 4, hard_brakes=n) for name, n in (("mine", 2), ("idm", 3)))
    mine[3] = replace(mine[3], decisions=1, hard_brakes=1)
    brakes = judged(mine, idm).criterion("hard brakes")
    assert (brakes.ours, brakes.theirs) == pytest.approx((7 / 6.02, 12 / 8))
    # by the delta method -0.554, -0.554, -0.554 and 0.312: 0.433 x 3.182 / 2 = 0.688
    assert brakes.difference == pytest.approx((-0.337, -0.337 - 0.688, -0.337 + 0.688), abs=1e-3)
    assert brakes.result == "undecided"


def comfortable(rows: list[EpisodeResult], *decisions: int) -> list[EpisodeResult]:
    comfort = [COMFORT | {"comfortable_decisions": number} for number in decisions]
    return [
        CriticalityResult(**asdict(row) | each)  # type: ignore[arg-type]
        for row, each in zip(rows, cycle(comfort), strict=False)
    ]


def test_with_criticality_comfort_is_nuplan_s_share_too() -> None:
    mine, among = drives("mine", *FASTER), comfortable(RULES, 90)
    for decisions, result in (((90,), "pass"), ((89,), "fail"), ((85, 94), "undecided")):
        found = judged(comfortable(mine, *decisions), among).criterion("comfort")
        assert found.result == result
        assert found.ours == pytest.approx(sum(decisions) / len(decisions))
        assert found.theirs == 90.0
    mine[3] = replace(mine[3], decisions=1)  # of all decisions, 270 of 301, not 67.5 %
    found = judged(comfortable(mine, 90, 90, 90, 0), among).criterion("comfort")
    assert found.ours == pytest.approx(100 * 270 / 301)
    with pytest.raises(KeyError, match="comfort"):
        judged(mine, RULES).criterion("comfort")


def test_without_a_rule_based_driver_no_driver_is_judged_and_other_traffic_is_refused() -> None:
    assert judge(drives("mine", *FASTER)) == judge(drives("pretrained", *FASTER)) == []
    assert [each.driver for each in judge(RULES)] == ["pretrained"]
    with pytest.raises(DrlAvError, match="mine and sumo did not drive the same traffic"):
        judge([*drives("mine", *FASTER[:2]), *RULES])


def test_the_function_returns_the_judgements() -> None:
    rows = Results([*drives("mine", *FASTER, times=ENOUGH), *rules(ENOUGH)])
    assert next((each.driver, each.passed) for each in rows.judgements) == ("mine", True)
    settings = {"simulation": {"decisions_per_episode": 3}}
    found = drl_av.evaluate(["random", "pretrained"], vehicles=2, episodes=1, config=settings)
    assert [each.over for each in found.judgements] == ["random"]
    assert [each.driver for each in found] == ["random", "pretrained"]


@pytest.mark.parametrize(("needed", "status"), [([], 0), (["--require-pass"], 1)])
def test_the_command_ends_with_the_judgement_and_its_status_is_1_only_if_asked(
    needed: list[str], status: int, tmp_path: Path, capsys: Capsys
) -> None:
    words = ["evaluate", "pretrained", "idm", "--vehicles", "2", "--episodes", "1", *needed]
    words += ["-o", "simulation.decisions_per_episode=3", "--json", str(tmp_path / "summary.json")]
    assert main(words) == status
    last = capsys.readouterr().out.split("pretrained: ")[-1]  # one episode is never sure
    assert last.startswith("UNDECIDED against idm\n  speed: undecided, ")
    assert "\n  collisions: undecided, 0 against 0 episodes of idm, +0.0 [" in last
    [found] = json.loads((tmp_path / "summary.json").read_text())["judgements"]
    assert (found["passed"], found["failures"]) == (False, [])
    speed = found["criteria"][0]
    assert (speed["name"], speed["result"], speed["over"]) == ("speed", "undecided", "idm")
    assert speed["difference"]["low"] is None


def test_a_single_episode_has_no_interval_and_no_infinite_one_is_printed() -> None:
    mine, theirs = episode("mine", 1, 25.0), episode("sumo", 1, 24.0)
    [judgement] = judge([mine, theirs])
    assert judgement.undecided == ("speed", "collisions", "hard brakes")
    assert " m/s, +1.00 [one seed]\n" in str(judgement)
    assert "inf" not in str(judgement)
