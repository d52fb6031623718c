"""Settings and roads for which the argument of ``strict`` does not hold: refused by their names.

A lane is 3.8 m wide, the ego 1.8 m: 0.9 m from its middle to its side, of which 0.05 m are on the
line. It decides once a second.
"""

import re
from contextlib import closing, nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drl_av.config import Config, with_files
from drl_av.drivers.rule_based import RandomDriver
from drl_av.driving.actions import Longitudinal
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.errors import ConfigError, DrlAvWarning
from drl_av.road.road import Road
from drl_av.road.vehicle_types import AS_WRITTEN, read_types, type_attributes
from drl_av.safety import named_check
from drl_av.safety.assumptions import ROAD_AS_WRITTEN
from drl_av.scenarios.folder import PlacedVehicle, ScenarioDescription, write_scenario
from verification.adversary import BatchStrict, Mover
from verification.falsification import genes, orders, play
from verification.families import FAMILIES, PLACED

STRICT = Config().updated("safety", check="strict")
PAPER = Config()
ROAD = ROAD_AS_WRITTEN
TRUCKS = "traffic.truck_share=0.1"


def refused(settings: str, sentence: str, road: Road = ROAD) -> None:
    """The sentence refuses settings, of which the check paper asks nothing."""
    strict, paper = (with_files(config, settings.split()) for config in (STRICT, PAPER))
    with pytest.raises(ConfigError, match=re.escape(sentence)) as refusal:
        named_check(strict, road=road)
    assert str(refusal.value).startswith("Under the check strict ")
    way_out = r": change (it|one of them), or take the check paper \(--safety-check paper\)\.$"
    assert re.search(way_out, str(refusal.value))
    named_check(paper, road=road)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ("traffic.acceleration_max_m_s2=2.1", "at most strict.acceleration_m_s2, 2, and not 2.1"),
        (f"{TRUCKS} traffic.truck_acceleration_m_s2=2.5", "2.5, because bou"),
        ("ego.hard_brake_m_s2=3.9", "at most ego.hard_brake_m_s2, 3.9, and not 4"),
        (
            "ego.hard_brake_m_s2=5.0",
            "ego.hard_brake_m_s2 must be at most strict.braking_m_s2, 4, and not 5, because the "
            "lemma following fails otherwise",
        ),
        ("ego.accelerate_m_s2=2.5", "accel of the vehicle type ego, 2, and not 2.5"),
        ("strict.follower_braking_m_s2=4.1", "decel of the vehicle type traffic, 4, and not 4.1"),
        ("strict.lateral_speed_m_s=0.7", "strict.lateral_speed_m_s, 0.7, and not 0.76"),
        ("simulation.step_length_s=1.0", "strict.follower_response_s, 0.5, and not 1"),
        (
            "simulation.step_length_s=1.0 strict.follower_response_s=1.0",
            "simulation.step_length_s must be at most traffic.headway_min_s, 0.8, and not 1,",
        ),
        # 0.84 m from where the body is over the line to where the centre is: 3.8 m take 4.53 s
        (
            "ego.lane_change_duration_s=4.0",
            "lane_change_duration_s must be at least 4.53, or one of some shorter ones, and not 4,",
        ),
        # on its way back the ego is 0.76 m from the middle; there again, 2.28 m a second later
        ("ego.lane_change_duration_s=2.5", "because the lemma abort fails: the centre"),
        ("ego.lane_change_duration_s=2.0", "and not 2, because the lemma abort fails"),
        ("ego.lane_change_duration_s=1.0", "and not 1, because the lemma abort fails"),
        (
            f"{TRUCKS} traffic.truck_width_m=3.75",
            "traffic.truck_width_m must be at most 3.7, and not 3.75, because bound 3 fails",
        ),
        ("traffic.random_lane_changes_per_s=0.3", "must be at most 0.01, and not 0.3"),
        (
            "strict.follower_braking_m_s2=0.4",
            "follower_braking_m_s2 must be at least 0.5, and not 0.4, because the lemma response",
        ),
        (
            "strict.clearance_m=0.0",
            "strict.clearance_m must be at least 0.001, and not 0, because the lemma rounding",
        ),
        (
            "simulation.lateral_resolution_m=0.95",
            "simulation.lateral_resolution_m must be at least the lane width, 3.8, and not 0.95",
        ),
        (
            f"{TRUCKS} traffic.truck_width_m=0.5",
            "traffic.truck_width_m must be at least 1.6, and not 0.5",
        ),
    ],
)
def test_settings_that_the_argument_does_not_cover_are_refused_in_one_sentence(
    settings: str, sentence: str
) -> None:
    refused(settings, sentence)


def test_roads_that_the_argument_does_not_cover_are_refused_in_one_sentence() -> None:
    # two vehicles of 1.8 m and SUMO's 0.6 m between them
    wide = replace(ROAD, lane_width_m=5.0)
    sentence = "the scenario's lane_width_m must be at most 4.2, and not 5"
    refused("simulation.lateral_resolution_m=5.0", sentence, wide)
    # 30 m in a second and 105 m to brake, 0.5 m to spare, two vehicles of 5 m
    refused("", "circumference_m must be at least 145.5", replace(ROAD, lap_m=145.4))
    trucks = f"{TRUCKS} traffic.truck_length_m=12.04"
    refused(trucks, "circumference_m must be at least 152.6, and", replace(ROAD, lap_m=152.5))
    fine = "at least the lane width, 3.1415926, and not 1"
    refused("simulation.lateral_resolution_m=1.0", fine, replace(ROAD, lane_width_m=3.1415926))
    width = f"{TRUCKS} traffic.truck_width_m=3.79"
    refused(width, "at most 3.5555555, and not", replace(ROAD, lane_width_m=3.6555555))
    # at 20 m/s, 22 m in the next second, rounded up to steps: 10.5 + 11 + 55 m
    sentence = "because bound 3 fails: the ego may need 77.5 m behind"
    refused("ego.max_speed_m_s=22.0", sentence, replace(ROAD, lap_m=80.0))


def test_what_it_just_covers_is_accepted() -> None:
    for duration_s in (3.0, 4.4, 4.53, 7.6):
        named_check(STRICT.updated("ego", lane_change_duration_s=duration_s))
    for reference in ("idm", "acc"):
        named_check(STRICT.updated("ego", longitudinal_reference=reference))
    named_check(STRICT.updated("simulation", step_length_s=0.1))
    named_check(STRICT.updated("traffic", random_lane_changes_per_s=0.01))
    named_check(STRICT, road=replace(ROAD, lap_m=145.5))
    wide = STRICT.updated("simulation", lateral_resolution_m=4.4)
    broad = read_types(type_attributes(5.0, 1.9), "twice 1.9 m, and 0.6 m between them")
    named_check(wide, broad, replace(ROAD, lane_width_m=4.4))
    named_check(STRICT.updated("traffic", truck_width_m=3.75, truck_acceleration_m_s2=5.0))
    named_check(STRICT.updated("traffic", truck_share=0.1, truck_width_m=3.7))
    # a wider ego is longer on the line: 3.8 m at 1.14 m a second
    ego = replace(AS_WRITTEN, ego=replace(AS_WRITTEN.ego, width_m=2.4))
    named_check(STRICT.updated("ego", lane_change_duration_s=3.5), ego)


def test_followers_that_must_brake_harder_than_the_ego_are_refused() -> None:
    weak = replace(AS_WRITTEN, ego=replace(AS_WRITTEN.ego, braking_m_s2=3.0))
    with pytest.raises(ConfigError, match="3, and not 4, because the lemma hand-over fails"):
        named_check(STRICT.updated("ego", hard_brake_m_s2=3.0), weak)


def test_an_environment_hands_its_road_over(tmp_path: Path) -> None:
    write_scenario(tmp_path / "short", ScenarioDescription(circumference_m=120.0))
    with pytest.raises(ConfigError, match=r"circumference_m must be at least 145\.5, and not 120"):
        HighwayEnv(tmp_path / "short", config=STRICT)


@pytest.mark.parametrize("duration_s", [3.0, 4.4, 20.0])
@pytest.mark.parametrize("name", ["cut-in", "both-sides", "anything"])
def test_a_random_adversary_finds_no_way_round_the_shortest_and_the_longest_lane_change(
    name: str, duration_s: float
) -> None:
    config = STRICT.updated("ego", lane_change_duration_s=duration_s)
    family, rng = FAMILIES[name], np.random.default_rng(4242)
    world = family.start(rng.random((600, PLACED * family.others)), config)
    genome = rng.normal(size=(600, genes(family)))
    _, ended = play(world, orders(genome, family, config), BatchStrict(config), Mover(config))
    assert not (ended == 1).any()


def test_a_start_from_which_braking_hard_does_not_help_is_reported(tmp_path: Path) -> None:
    # from 30 m/s it takes 105 m; the standing vehicle is 104.0 m or 105.6 m ahead, 0.5 m to spare
    for gap_m, unsafe in ((105.6, False), (104.0, True)):
        ego = PlacedVehicle("ego", 1, 10.0, 30.0, 30.0)
        standing = PlacedVehicle("standing", 1, 15.0 + gap_m, 0.0, 0.1)
        folder = tmp_path / str(gap_m)
        write_scenario(folder, ScenarioDescription(vehicles=(ego, standing)))
        with closing(HighwayEnv(folder, config=STRICT)) as env:
            assert env.reset(seed=0)[1]["unsafe_start"] is unsafe
            over = False
            while not over and env.scene.affordances.ego_speed_m_s > 0:
                over = env.step(Longitudinal.HARD_BRAKE)[2]
            assert over is unsafe
            with (
                pytest.warns(DrlAvWarning, match="begins where strict") if unsafe else nullcontext()
            ):
                next(rollout(env, RandomDriver(), 0))
        with closing(HighwayEnv(folder, safety_check="paper")) as env:
            assert env.reset(seed=0)[1]["unsafe_start"] is False


def test_random_starts_of_every_density_are_safe() -> None:
    with closing(HighwayEnv(config=STRICT)) as env:
        for seed in range(60):
            info = env.reset(seed=seed, options={"vehicles": 1 + seed % 40})[1]
            assert info["unsafe_start"] is False
