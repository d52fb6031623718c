"""The adversary that looks for a way round a check, and finds one round the paper's only."""

import warnings

import numpy as np
import pytest

from drl_av.config import Config
from drl_av.drivers.rule_based import RandomDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.safety import named_check
from verification.adversary import NONE, BatchStrict, Mover, one_by_one
from verification.falsification import genes, orders, play, scripted, search
from verification.falsify import SEARCHED
from verification.families import FAMILIES, PLACED

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
    env = HighwayEnv(config=STRICT.updated("simulation", decisions_per_episode=100))
    results = [drive(env, RandomDriver(), "random", 850_000 + n, n) for n in (5, 15, 30)]
    env.close()
    assert not any(result.ego_hit for result in results)
    assert sum(result.safety_triggers for result in results) > 20
