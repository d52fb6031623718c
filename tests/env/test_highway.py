"""``drl_av/Highway-v0`` on real SUMO."""

import hashlib
import itertools
import multiprocessing
import os
import re
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from worlds import CENTER, LANE_M

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, Lateral, Longitudinal
from drl_av.driving.affordances import INDICATORS
from drl_av.driving.scene import LaneChange, Scene
from drl_av.env import highway
from drl_av.env.episode import TRAINING_SEEDS
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ConfigError, ScenarioError
from drl_av.safety.check import Rule, Verdict
from drl_av.traffic.scenario import PlacedVehicle, ScenarioDescription, write_scenario
from drl_av.traffic.snapshot import Collision, CollisionKind

KEEP, BRAKE, HARD_BRAKE, RIGHT, LEFT = 0, 2, 3, 4, 8
"""Numbers of actions; right and left at an unchanged speed."""
ID = "drl_av/Highway-v0"
TESTS = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def env() -> Iterator[HighwayEnv]:
    """The environment as it comes; every test resets it."""
    made = HighwayEnv()
    yield made
    made.close()


@pytest.fixture(scope="module")
def unchecked() -> Iterator[HighwayEnv]:
    """Without a safety check."""
    made = HighwayEnv(safety_check="permit_all")
    yield made
    made.close()


@pytest.fixture(scope="module")
def barricaded() -> Iterator[HighwayEnv]:
    made = HighwayEnv("barricaded_right_lane")
    yield made
    made.close()


Place = Callable[..., HighwayEnv]


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    """Makes an environment in which vehicles stand exactly where a test wants them."""
    made = []

    def placed(*vehicles: PlacedVehicle, **arguments: Any) -> HighwayEnv:
        folder = tmp_path / f"scenario{len(made)}"
        write_scenario(folder, ScenarioDescription(vehicles=vehicles))
        made.append(HighwayEnv(folder, **({"safety_check": "permit_all"} | arguments)))
        return made[-1]

    yield placed
    for one in made:
        one.close()


def start(env: HighwayEnv, vehicles: int, seed: int = 0) -> dict[str, Any]:
    return env.reset(seed=seed, options={"vehicles": vehicles})[1]


def y_m(env: HighwayEnv) -> float:
    return float(env.scene.snapshot.y_m[0])


def until_over(env: HighwayEnv, action: int, at_most: int = 20) -> dict[str, Any]:
    """Info of the step that ended the episode."""
    for _ in range(at_most):
        _, reward, terminated, _, info = env.step(action)
        if terminated:
            assert reward == env.config.reward.collision_reward
            return info
        assert info["collision"] is None
    raise AssertionError(f"nothing ended in {at_most} decisions")


# The face that gymnasium and stable-baselines3 know


def test_gymnasium_has_nothing_to_say(env: HighwayEnv) -> None:
    made = gymnasium.make(ID)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(made.unwrapped, skip_render_check=True)
    made.close()
    told = [str(warning.message) for warning in caught]
    assert not told


def test_stable_baselines3_has_nothing_to_say(env: HighwayEnv) -> None:
    # imported here: torch comes along, and workers that import this file do without it
    from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env_of_sb3(env, warn=True, skip_render_check=True)


def test_made_by_its_id_it_takes_the_arguments_of_its_docstring() -> None:
    made = gymnasium.make(ID, scenario="barricaded_right_lane", safety_check="permit_all")
    assert isinstance(made.unwrapped, HighwayEnv)
    assert made.unwrapped.config.safety.check == "permit_all"
    assert made.unwrapped.road.open_lanes == (False, True, True)
    made.close()


def table(heading: str) -> list[tuple[str, str]]:
    """Rows of the table under a heading of the docstring."""
    section = str(HighwayEnv.__doc__).split(f"## {heading}")[1].split("\n    ## ")[0]
    return re.findall(r"^    \| (\d+) \| (.+) \|$", section, re.MULTILINE)


def test_docstring_lists_the_12_actions_and_the_27_indicators() -> None:
    actions, indicators = table("Action Space"), table("Observation Space")
    assert actions == [(str(action.number), str(action)) for action in ACTIONS]
    assert indicators == [(str(place), name) for place, name in enumerate(INDICATORS)]
    assert (len(actions), len(indicators)) == (12, 27)


def test_observation_is_the_indicators_scaled(env: HighwayEnv) -> None:
    observation, info = env.reset(seed=1, options={"vehicles": 30})
    assert observation.dtype == np.float32
    assert observation.shape == info["indicators"].shape == (27,)
    assert np.array_equal(info["indicators"], env.scene.affordances.vector())
    assert info["indicators"][24] == info["speed_m_s"] == env.scene.snapshot.speed_m_s[0]
    assert observation[24] == pytest.approx((info["speed_m_s"] - 15) / 15, abs=1e-6)
    assert env.observation_space.contains(observation)


def test_info_of_a_step_tells_what_happened(env: HighwayEnv) -> None:
    start(env, 5, seed=3)
    _, reward, terminated, truncated, info = env.step(np.int64(1))
    assert (terminated, truncated) == (False, False)
    assert set(info) == {
        *("proposed_action", "executed_action", "rule", "rewards", "collision"),
        *("speed_m_s", "indicators", "seed", "vehicles"),
    }
    assert (info["proposed_action"], info["seed"], info["vehicles"]) == (1, 3, 5)
    assert set(info["rewards"]) == {"r_v", "r_y", "r_x"}
    assert reward == pytest.approx(sum(info["rewards"].values()) / 3)
    assert isinstance(reward, float)


def test_a_rule_that_fires_is_told_with_both_actions(barricaded: HighwayEnv) -> None:
    start(barricaded, 0)
    while y_m(barricaded) != pytest.approx(CENTER):
        barricaded.step(RIGHT)
    _, _, terminated, _, info = barricaded.step(RIGHT)
    assert (info["proposed_action"], info["executed_action"]) == (RIGHT, KEEP)
    assert info["rule"] == "off_road"
    assert not terminated


def test_rgb_array_is_a_picture_of_720_rows() -> None:
    made = HighwayEnv(render_mode="rgb_array")
    start(made, 10)
    before = made.render()
    made.step(1)
    after = made.render()
    assert before is not None
    assert after is not None
    assert before.shape == after.shape == (720, 1280, 3)
    assert before.dtype == np.uint8
    assert not np.array_equal(before, after)
    made.close()


def test_without_a_render_mode_there_is_no_picture(env: HighwayEnv) -> None:
    start(env, 1)
    assert env.render() is None


# Order


def test_a_step_checks_plans_advances_and_looks_in_this_order(
    env: HighwayEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    tape: list[str] = []

    def taped(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def play(*arguments: Any) -> Any:
            tape.append(name)
            return function(*arguments)

        return play

    start(env, 5)
    monkeypatch.setattr(env, "safety_check", taped("check", env.safety_check))
    monkeypatch.setattr(highway, "plan", taped("plan", highway.plan))
    monkeypatch.setattr(env, "traffic_drivers", taped("traffic", env.traffic_drivers))
    monkeypatch.setattr(env.simulation, "advance", taped("advance", env.simulation.advance))
    monkeypatch.setattr(highway, "compute_affordances", taped("look", highway.compute_affordances))
    monkeypatch.setattr(highway, "rewards", taped("reward", highway.rewards))
    env.step(0)
    env.step(1)
    assert tape == ["check", "plan", "traffic", "advance", "look", "reward"] * 2


def test_the_check_judges_the_scene_of_the_last_observation_and_is_obeyed() -> None:
    judged: list[Scene] = []

    def always_brake(scene: Scene, proposed: Any) -> Verdict:
        judged.append(scene)
        return Verdict(ACTIONS[BRAKE], Rule.IN_LANE)

    made = HighwayEnv(safety_check=always_brake)
    info = start(made, 3, seed=1)
    speeds = [info["speed_m_s"]]
    for _ in range(3):
        scene = made.scene
        _, _, _, _, info = made.step(1)
        assert judged[-1] is scene
        assert (info["executed_action"], info["rule"]) == (BRAKE, "in_lane")
        speeds.append(info["speed_m_s"])
    assert np.diff(speeds) == pytest.approx([-2, -2, -2], abs=1e-6)
    made.close()


# Lane changes in real SUMO


@pytest.mark.parametrize("step_length_s", [0.5, 0.2])
def test_a_lane_change_moves_0_76_m_in_each_second_and_ends_exactly_on_the_centre(
    step_length_s: float,
) -> None:
    made = HighwayEnv(config=Config().updated("simulation", step_length_s=step_length_s))
    for seed in range(3):
        start(made, 0, seed)
        origin = made.scene.affordances.lane
        side = LEFT if origin < 2 else RIGHT
        sign = ACTIONS[side].lateral.sign
        for second in range(1, 6):
            _, _, _, _, info = made.step(side if second == 1 else KEEP)
            assert y_m(made) == pytest.approx(origin * LANE_M + sign * 0.76 * second, abs=1e-9)
            assert info["indicators"][26] == pytest.approx(0.76 * sign if second < 5 else 0)
        assert y_m(made) == pytest.approx((origin + sign) * LANE_M, abs=1e-12)
        assert made.scene.lane_change is None
        made.step(KEEP)
        assert y_m(made) == pytest.approx((origin + sign) * LANE_M, abs=1e-12)
    made.close()


@pytest.mark.parametrize("away", [1, 2, 3, 4])
def test_a_lane_change_can_be_aborted_in_each_second(env: HighwayEnv, away: int) -> None:
    start(env, 0)
    origin = env.scene.affordances.lane
    there, back = (LEFT, RIGHT) if origin < 2 else (RIGHT, LEFT)
    sign = ACTIONS[there].lateral.sign
    ways = []
    for action in (there, *[KEEP] * (away - 1), back, *[KEEP] * (away - 1)):
        env.step(action)
        ways.append((y_m(env) - origin * LANE_M) * sign / 0.76)
    assert ways == pytest.approx([*range(1, away + 1), *range(away - 1, -1, -1)], abs=1e-9)
    assert y_m(env) == pytest.approx(origin * LANE_M, abs=1e-12)
    assert env.scene.lane_change is None


def test_lane_changes_across_the_seam_and_every_edge_of_the_loop_are_no_different(
    place: Place,
) -> None:
    # at 30 m/s the ego passes all four edges, and the seam, in the middle of lane changes
    made = place(PlacedVehicle("ego", 0, 20.0, 30.0, 30.0))
    made.reset(seed=0)
    position_m = made.scene.snapshot.s_m[0]
    for decision in range(40):
        made.step(LEFT if decision % 20 < 10 else RIGHT)
        part = decision % 20 + 1
        expected = 0.76 * part if part <= 10 else 7.6 - 0.76 * (part - 10)
        assert y_m(made) == pytest.approx(expected, abs=1e-9)
        moved_m = (made.scene.snapshot.s_m[0] - position_m) % 500
        assert moved_m == pytest.approx(30.0, abs=1e-6)
        position_m = made.scene.snapshot.s_m[0]


def test_what_is_in_progress_is_readable_from_position_and_velocity(env: HighwayEnv) -> None:
    rng = np.random.default_rng(0)
    start(env, 3)
    for _ in range(150):
        _, _, terminated, _, info = env.step(int(rng.integers(12)))
        assert not terminated
        y, v_y = info["indicators"][25], info["indicators"][26]
        running = env.scene.lane_change
        if running is None:
            assert v_y == 0
            assert y / LANE_M == pytest.approx(round(y / LANE_M), abs=1e-9)
        else:
            right = int(y // LANE_M)
            assert running == LaneChange(*((right, right + 1) if v_y > 0 else (right + 1, right)))


@pytest.mark.parametrize(
    ("action", "change"),
    [(KEEP, 0.0), (1, 2.0), (BRAKE, -2.0), (HARD_BRAKE, -4.0)],
)
def test_speed_changes_by_the_acceleration_in_one_second(
    place: Place, action: int, change: float
) -> None:
    made = place(PlacedVehicle("ego", 1, 20.0, 20.0, 30.0))
    made.reset(seed=0)
    _, _, _, _, info = made.step(action)
    assert info["speed_m_s"] == pytest.approx(20 + change, abs=1e-9)


# Traffic


@pytest.mark.parametrize("vehicles", [1, 30])
@pytest.mark.parametrize("seed", range(3))
def test_every_vehicle_is_on_the_road_from_the_first_decision(
    env: HighwayEnv, vehicles: int, seed: int
) -> None:
    info = start(env, vehicles, seed)
    sumo = env.simulation._sumo
    assert info["vehicles"] == vehicles
    for _ in range(3):
        shot = env.scene.snapshot
        assert shot.ids == ("ego", *(f"vehicle{i}" for i in range(1, vehicles + 1)))
        assert set(shot.ids) <= set(sumo.vehicle.getIDList())
        assert all(sumo.vehicle.getRoadID(name) for name in shot.ids)
        assert ((shot.s_m >= 0) & (shot.s_m < 500)).all()
        assert ((shot.y_m > -1) & (shot.y_m < 8.6)).all()
        assert ((shot.speed_m_s >= 0) & (shot.speed_m_s < 40)).all()
        env.step(KEEP)


def test_traffic_moves_by_its_speed_and_the_ego_is_where_it_was_told(env: HighwayEnv) -> None:
    start(env, 30, seed=2)
    before = env.scene.snapshot
    env.step(KEEP)
    after = env.scene.snapshot
    moved_m = (after.s_m - before.s_m) % 500
    lowest = np.minimum(before.speed_m_s, after.speed_m_s)
    highest = np.maximum(before.speed_m_s, after.speed_m_s)
    assert (moved_m > lowest - 3).all()
    assert (moved_m < highest + 3).all()
    assert moved_m[0] == pytest.approx(before.speed_m_s[0], abs=1e-6)


def test_without_the_option_the_number_of_vehicles_is_drawn_from_the_config() -> None:
    config = Config().updated("traffic", vehicles_min=2, vehicles_max=4)
    made = HighwayEnv(config=config)
    numbers = {made.reset(seed=seed)[1]["vehicles"] for seed in range(30)}
    assert numbers == {2, 3, 4}
    assert made.reset(seed=7)[1]["vehicles"] == made.reset(seed=7)[1]["vehicles"]
    made.close()


def test_an_unseeded_reset_never_draws_a_seed_of_evaluation(env: HighwayEnv) -> None:
    env.reset(seed=5)
    seeds = [env.reset()[1]["seed"] for _ in range(10)]
    assert len(set(seeds)) == 10
    assert all(TRAINING_SEEDS[0] <= seed < TRAINING_SEEDS[1] for seed in seeds)
    env.reset(seed=5)
    assert [env.reset()[1]["seed"] for _ in range(10)] == seeds


def test_a_client_s_small_seed_is_that_of_no_episode_of_evaluation(env: HighwayEnv) -> None:
    observation, info = env.reset(seed=0)
    assert TRAINING_SEEDS[0] <= info["seed"] < TRAINING_SEEDS[1]
    for seed in (0, info["seed"]):  # which is that of the same traffic
        again, same = env.reset(seed=seed)
        assert np.array_equal(again, observation)
        assert (same["seed"], same["vehicles"]) == (info["seed"], info["vehicles"])
    assert env.reset(seed=1)[1]["seed"] != info["seed"]
    named = {"vehicles": info["vehicles"]}
    evaluated, info = env.reset(seed=0, options=named)
    assert (info["seed"], info["vehicles"]) == (0, named["vehicles"])
    assert not np.array_equal(evaluated, observation)
    assert env.reset(seed=TRAINING_SEEDS[0], options={})[1]["seed"] == TRAINING_SEEDS[0]
    assert env.reset(seed=999_999)[1]["seed"] >= TRAINING_SEEDS[0]


# Episode ends


def test_an_episode_is_truncated_after_200_decisions(env: HighwayEnv) -> None:
    start(env, 0)
    for decision in range(1, 201):
        _, _, terminated, truncated, _ = env.step(KEEP)
        assert not terminated
        assert truncated is (decision == 200)


def test_the_number_of_decisions_is_counted_anew_in_each_episode() -> None:
    made = HighwayEnv(config=Config().updated("simulation", decisions_per_episode=3))
    for _ in range(2):
        start(made, 1)
        assert [made.step(KEEP)[3] for _ in range(3)] == [False, False, True]
    made.close()


def test_ego_at_30_m_s_rear_ends_one_at_5(place: Place) -> None:
    made = place(
        PlacedVehicle("ego", 1, 50.0, 30.0, 30.0), PlacedVehicle("slow", 1, 130.0, 5.0, 5.0)
    )
    made.reset(seed=0)
    info = until_over(made, KEEP)
    assert info["collision"] == Collision(CollisionKind.HIT_AHEAD, "slow")
    assert info["collision"].kind.ego_hit
    # 75 m at 25 m/s: the third second
    assert made.decisions == 3


def test_ego_standing_is_hit_from_behind(place: Place) -> None:
    made = place(
        PlacedVehicle("ego", 1, 100.0, 0.0, 30.0), PlacedVehicle("fast", 1, 88.0, 30.0, 30.0)
    )
    made.reset(seed=0)
    info = until_over(made, KEEP)
    assert info["collision"] == Collision(CollisionKind.HIT_FROM_BEHIND, "fast")
    assert not info["collision"].kind.ego_hit


@pytest.mark.parametrize(("lane", "action"), [(2, LEFT), (0, RIGHT)])
def test_ego_swipes_the_vehicle_alongside(place: Place, lane: int, action: int) -> None:
    made = place(
        PlacedVehicle("ego", 1, 100.0, 20.0, 30.0), PlacedVehicle("beside", lane, 102.0, 20.0, 20.0)
    )
    made.reset(seed=0)
    info = until_over(made, action)
    assert info["collision"] == Collision(CollisionKind.HIT_BESIDE, "beside")
    # 2 m between the bodies at 0.76 m/s: the third second
    assert made.decisions == 3


@pytest.mark.parametrize(("lane", "action"), [(0, RIGHT), (2, LEFT)])
def test_ego_leaves_the_road(place: Place, lane: int, action: int) -> None:
    made = place(PlacedVehicle("ego", lane, 100.0, 20.0, 30.0))
    made.reset(seed=0)
    info = until_over(made, action)
    assert info["collision"] == Collision(CollisionKind.HIT_EDGE, None)
    assert info["collision"].kind.ego_hit
    # 1 m from its side to the edge at 0.76 m/s: the second second
    assert made.decisions == 2


def test_ego_runs_into_the_barricade(unchecked: HighwayEnv) -> None:
    made = HighwayEnv("barricaded_right_lane", safety_check="permit_all")
    start(made, 0)
    info = until_over(made, RIGHT)
    assert info["collision"] == Collision(CollisionKind.HIT_EDGE, None)
    assert y_m(made) > 2.8
    made.close()


def test_under_the_check_the_same_driver_does_none_of_this(place: Place) -> None:
    made = place(
        PlacedVehicle("ego", 1, 50.0, 20.0, 30.0),
        PlacedVehicle("slow", 1, 130.0, 5.0, 5.0),
        PlacedVehicle("beside", 2, 50.0, 20.0, 20.0),
        safety_check="paper",
    )
    made.reset(seed=0)
    rules = set()
    for action in itertools.islice(itertools.cycle([LEFT + 1, RIGHT + 1, 1]), 60):
        _, _, terminated, _, info = made.step(action)
        rules.add(info["rule"])
        assert not terminated
    assert len(rules) > 1


# Scenarios


def test_a_barricaded_lane_is_no_lane_for_anyone(barricaded: HighwayEnv) -> None:
    for seed in range(3):
        start(barricaded, 30, seed)
        for decision in range(60):
            info = barricaded.step((LEFT, RIGHT, KEEP)[decision % 3])[4]
            assert info["collision"] is None
            assert (barricaded.scene.snapshot.y_m - 0.9 > 1.9 - 1e-6).all()
            if barricaded.scene.affordances.lane == 1:
                right = info["indicators"][8:16]
                offset_m = -info["indicators"][25]
                assert right == pytest.approx([0, 0, offset_m, 0] * 2, abs=1e-9)


def test_placed_vehicles_start_exactly_where_the_scenario_has_them(place: Place) -> None:
    made = place(
        PlacedVehicle("fast", 0, 3.0, 31.0, 32.0),  # its body lies across the seam
        PlacedVehicle("ego", 1, 126.0, 22.0, 30.0),  # and the ego's across two edges
        PlacedVehicle("slow", 1, 160.0, 12.5, 14.0),
        PlacedVehicle("far", 2, 499.5, 20.0, 25.0),
    )
    for seed in (0, 1):
        _, info = made.reset(seed=seed)
        shot = made.scene.snapshot
        assert info["vehicles"] == 3
        assert shot.ids == ("ego", "fast", "slow", "far")
        assert shot.s_m == pytest.approx([123.5, 0.5, 157.5, 497.0])
        assert shot.y_m == pytest.approx([CENTER, 0.0, CENTER, 7.6])
        assert shot.speed_m_s == pytest.approx([22.0, 31.0, 12.5, 20.0])
        assert not shot.lateral_speed_m_s.any()
        front = made.scene.affordances.own_front
        assert front is not None
        assert (front.gap_m, front.relative_speed_m_s) == pytest.approx((29.0, -9.5))


def test_a_scenario_that_places_its_vehicles_takes_no_other_number(place: Place) -> None:
    made = place(PlacedVehicle("ego", 1, 20.0, 20.0, 30.0), PlacedVehicle("a", 0, 9.0, 20.0, 30.0))
    assert start(made, 1)["vehicles"] == 1
    with pytest.raises(ConfigError, match=r"vehicles is 2, but the scenario places 1 vehicles"):
        start(made, 2)


# The same again


def trajectory(env: HighwayEnv, seed: int, decisions: int = 200) -> str:
    """SHA-256 over all positions and speeds of an episode of fixed decisions."""
    env.reset(seed=seed, options={"vehicles": 30})
    digest = hashlib.sha256()
    for decision in range(decisions + 1):
        shot = env.scene.snapshot
        for values in (shot.s_m, shot.y_m, shot.speed_m_s, shot.lateral_speed_m_s):
            digest.update(np.ascontiguousarray(values).tobytes())
        if decision == decisions or env.step(decision * 5 % 12)[2]:
            break
    return f"{env.decisions} {digest.hexdigest()}"


def trajectory_of_a_fresh_process(seed: int) -> str:
    env = HighwayEnv()
    try:
        return trajectory(env, seed)
    finally:
        env.close()


@pytest.fixture(scope="module")
def hashes(env: HighwayEnv) -> dict[int, str]:
    """Of two full episodes by their seed; the second was driven after the first and others."""
    made: dict[int, str] = {}
    for seed in range(50):
        text = trajectory(env, seed)
        if text.startswith("200 "):
            made[seed] = text
        if len(made) == 2:
            return made
    raise AssertionError("hardly an episode lasts")


def test_a_seed_is_the_same_trajectory_again_and_another_seed_another(
    env: HighwayEnv, hashes: dict[int, str]
) -> None:
    assert len(set(hashes.values())) == 2
    start(env, 7, seed=99)
    for action in (1, 5, 9):
        env.step(action)
    assert {seed: trajectory(env, seed) for seed in reversed(hashes)} == hashes


def test_a_seed_is_the_same_trajectory_after_sumo_was_ended_or_taken_over(
    env: HighwayEnv, unchecked: HighwayEnv, hashes: dict[int, str]
) -> None:
    seed, hashed = next(iter(hashes.items()))
    env.close()
    assert trajectory(env, seed) == hashed
    start(unchecked, 30, seed=1)
    unchecked.step(9)
    assert trajectory(env, seed) == hashed


def test_a_seed_is_the_same_trajectory_in_a_fresh_process(hashes: dict[int, str]) -> None:
    seed, hashed = max(hashes.items())
    program = (
        f"import sys; sys.path[:0] = {[str(TESTS), str(TESTS / 'env')]}; import test_highway; "
        f"print(test_highway.trajectory_of_a_fresh_process({seed}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONHASHSEED": "12345"},
    )
    assert done.stdout.split() == hashed.split()


def test_a_seed_is_the_same_trajectory_in_spawned_workers(hashes: dict[int, str]) -> None:
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        assert pool.map(trajectory_of_a_fresh_process, hashes) == list(hashes.values())


def test_reset_with_a_seed_gives_the_same_observation(env: HighwayEnv) -> None:
    first, info = env.reset(seed=4, options={"vehicles": 12})
    other, _ = env.reset(seed=5, options={"vehicles": 12})
    again, info_again = env.reset(seed=4, options={"vehicles": 12})
    assert np.array_equal(first, again)
    assert np.array_equal(info["indicators"], info_again["indicators"])
    assert not np.array_equal(first, other)


def test_info_and_observation_of_a_step_are_not_overwritten_by_the_next(env: HighwayEnv) -> None:
    start(env, 20)
    observation, _, _, _, info = env.step(1)
    kept = observation.copy(), info["indicators"].copy()
    env.step(HARD_BRAKE)
    assert np.array_equal(observation, kept[0])
    assert np.array_equal(info["indicators"], kept[1])


# Several at once


def test_two_drive_at_once_in_one_process(env: HighwayEnv, unchecked: HighwayEnv) -> None:
    start(env, 3)
    env.step(KEEP)
    start(unchecked, 3)
    for _ in range(2):
        unchecked.step(KEEP)
        env.step(KEEP)
    assert env.scene.snapshot.time_s == 3.0
    assert unchecked.scene.snapshot.time_s == 2.0


def test_several_drive_at_once_in_spawned_workers_each_as_if_alone(env: HighwayEnv) -> None:
    config = Config().updated("traffic", vehicles_min=20, vehicles_max=20)
    vector = gymnasium.make_vec(
        ID,
        num_envs=2,
        vectorization_mode="async",
        vector_kwargs={"context": "spawn"},
        safety_check="permit_all",
        config=config,
    )
    try:
        observations, info = vector.reset(seed=[21, 22])
        together = [observations]
        assert info["vehicles"].tolist() == [20, 20]
        for action in (1, 0, 2, 1):
            observations, _, _, _, info = vector.step(np.array([action, 0]))
            together.append(observations)
        assert info["executed_action"].tolist() == [1, 0]
    finally:
        vector.close()
    alone = HighwayEnv(safety_check="permit_all", config=config)
    for column, seed in enumerate((21, 22)):
        observation, _ = alone.reset(seed=seed)
        assert np.array_equal(observation, together[0][column])
        for row, action in enumerate((1, 0, 2, 1), 1):
            observation = alone.step(action if column == 0 else 0)[0]
            assert np.array_equal(observation, together[row][column])
    alone.close()


# Bad input


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"vehicle": 3}, r"no option 'vehicle'; its option is: vehicles"),
        ({"vehicles": -1}, r"vehicles is -1, but must be a whole number from 0"),
        ({"vehicles": 2.5}, r"vehicles is 2.5, but must be a whole number"),
        ({"vehicles": "many"}, r"vehicles is 'many', but must be a whole number"),
    ],
)
def test_reset_refuses_what_it_does_not_know(
    env: HighwayEnv, options: dict[str, Any], told: str
) -> None:
    with pytest.raises(ConfigError, match=told):
        env.reset(seed=0, options=options)


def test_reset_refuses_more_vehicles_than_fit_and_goes_on_after_it(env: HighwayEnv) -> None:
    with pytest.raises(ScenarioError, match=r"^500 vehicles do not fit .* take 113 beside"):
        start(env, 500)
    start(env, 113)
    env.step(KEEP)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"safety_check": "papper"}, r"'papper' \(did you mean 'paper'\?\)"),
        ({"safety_check": "permitall"}, r"\(did you mean 'permit_all'\?\)"),
        ({"render_mode": "ansi"}, r"render_mode is 'ansi', but must be None, 'human' or 'rgb_arr"),
        ({"config": "/nowhere/settings.toml"}, r"/nowhere/settings.toml', but must be a preset"),
    ],
)
def test_an_environment_refuses_bad_arguments(arguments: dict[str, Any], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        HighwayEnv(**arguments)


def test_an_unknown_scenario_is_told_with_the_nearest_name() -> None:
    with pytest.raises(ScenarioError, match=r"did you mean 'circular_three_lane'\?"):
        HighwayEnv("circular_3_lane")


@pytest.mark.parametrize("action", [12, 99])
def test_an_action_that_is_none_is_refused(env: HighwayEnv, action: int) -> None:
    start(env, 1)
    with pytest.raises((IndexError, ConfigError, ValueError)):
        env.step(action)


def test_hard_brake_is_the_hardest_the_check_may_answer(env: HighwayEnv) -> None:
    hardest = min(how.acceleration_m_s2(env.config.ego) for how in Longitudinal)
    start(env, 30, seed=6)
    before = start(env, 30, seed=6)["speed_m_s"]
    for _ in range(100):
        _, _, terminated, _, info = env.step(LEFT + 1)
        assert info["speed_m_s"] - before >= hardest - 1e-9
        assert info["speed_m_s"] <= env.config.ego.max_speed_m_s
        before = info["speed_m_s"]
        if terminated:
            break


def test_a_copy_of_the_config_drives_alike(env: HighwayEnv, hashes: dict[int, str]) -> None:
    twin = HighwayEnv(config=replace(env.config))
    seed, hashed = next(iter(hashes.items()))
    assert trajectory(twin, seed) == hashed
    assert Lateral.KEEP == 0
    twin.close()
