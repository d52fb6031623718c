"""The adversary that looks for a way round a check, and finds one round the paper's only."""

import warnings

import numpy as np
import pytest

from drl_av.config import Config
from drl_av.drivers.rule_based import RandomDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.errors import ConfigError
from drl_av.safety import named_check
from verification import falsify
from verification.adversary import NONE, BatchStrict, Mover, one_by_one
from verification.falsification import genes, orders, play, scripted, search
from verification.falsify import SEARCHED
from verification.families import FAMILIES, PLACED, needed_gap

STRICT = Config().updated("safety", check="strict")


@pytest.mark.parametrize("name", SEARCHED)
def test_the_adversary_finds_no_way_round_strict(name: str) -> None:
    family, check = SEARCHED[name], BatchStrict(STRICT)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tallies = list(search(family, STRICT, check, Mover(STRICT), 200, 1))
    assert sum(tally.scenes for tally in tallies) >= 200
    assert sum(tally.ego_hits for tally in tallies) == 0


def test_the_paper_check_drives_into_a_vehicle_that_brakes_to_a_stop() -> None:
    family = FAMILIES["lead-brakes"]
    placing = np.random.default_rng(0).random((200, PLACED * family.others))
    world = family.start(placing, Config())
    check = one_by_one(named_check(Config()))
    _, ended = play(world, scripted(family, 200), check, Mover(Config()))
    assert (ended == 1).any()


def test_a_check_of_the_user_begins_where_strict_and_the_paper_could_still_protect_the_ego() -> (
    None
):
    speed, other = np.array([30.0, 20.0]), np.array([10.0, 20.0])
    own, paper, strict = (
        needed_gap(speed, other, Config().updated("safety", check=check))
        for check in ("my_check:mine", "paper", "strict")
    )
    # the paper: 15 m + 3 s * 20 m/s, and 15 m + 0
    assert paper == pytest.approx([75.0, 15.0], abs=0.01)
    # strict: the ego rolls 0.5 s * (28 + 26 + ... + 2) = 105 m, the other 0.5 s * (8 + ... + 2)
    assert strict == pytest.approx([105.0 - 10.0 + 0.5, 0.5], abs=0.01)
    assert own.tolist() == [strict[0], paper[1]]


@pytest.mark.parametrize(
    ("check", "hits", "status"),
    [
        *(("my_check:mine", (0, 2), 1), ("my_check:mine", (0, 0), 0)),
        *(("strict", (1, 0), 1), ("paper", (5, 5), 0)),
    ],
)
def test_an_ego_that_is_hit_counts_as_one_that_hits(
    check: str, hits: tuple[int, int], status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [dict(zip(("ego_hit", "was_hit"), hits, strict=True))]
    monkeypatch.setattr(falsify, "search", lambda *given: rows)
    words = ["falsify", "--search", "--safety-check", check, "--scenes", "1"]
    monkeypatch.setattr("sys.argv", words)
    assert falsify.main() == status


def test_a_check_that_returns_no_verdict_is_refused_in_the_search_too() -> None:
    world = FAMILIES["lead-brakes"].start(np.full((1, PLACED), 0.5), Config())
    check = one_by_one(lambda scene, proposed: None)  # type: ignore[arg-type,return-value]
    with pytest.raises(ConfigError, match="must return a Verdict"):
        check(world, np.array([1]))


@pytest.mark.parametrize("name", SEARCHED)
def test_many_scenes_at_once_are_judged_as_one_by_one_to_their_end(name: str) -> None:
    family, rng, changing, aside = SEARCHED[name], np.random.default_rng(2), 0, 0
    world = family.start(rng.random((60, PLACED * family.others)), STRICT)
    at_once, alone, mover = BatchStrict(STRICT), one_by_one(named_check(STRICT)), Mover(STRICT)
    for order in orders(rng.normal(size=(60, genes(family))), family, STRICT):
        proposals = rng.integers(0, 12, 60)
        executed = at_once(world, proposals)
        assert executed.tolist() == alone(world, proposals).tolist()
        changing += int((world.target != NONE).sum())
        aside += int((world.lateral_m_s[:, 1:] != 0).sum())
        mover.decision(world, executed, order)
    assert changing > 0
    assert aside > 0


def test_the_random_driver_hits_nothing_under_strict_in_sumo() -> None:
    with HighwayEnv(config=STRICT.updated("simulation", decisions_per_episode=100)) as env:
        results = [drive(env, RandomDriver(), "random", 850_000 + n, n) for n in (5, 15, 30)]
    assert not any(result.ego_hit for result in results)
    assert sum(result.safety_triggers for result in results) > 20
