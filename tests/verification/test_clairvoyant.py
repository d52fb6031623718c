"""The search that knows the future: plans, copies of an episode, and what it drives."""

from copy import deepcopy

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from drl_av.arrays import IntArray
from drl_av.config import Config
from drl_av.drivers.registry import load_driver
from drl_av.driving.actions import ACCELERATE, BRAKE, KEEP, LEFT, MAINTAIN, RIGHT
from drl_av.driving.affordances import CODES, LANE, LEFT_LANE, RIGHT_LANE
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.env.vector import TwinVectorEnv
from drl_av.errors import ConfigError
from verification.clairvoyant import HORIZON, Execution, Plan, Search, policy

TWIN = Config().updated("simulation", world="twin", decisions_per_episode=30)


@pytest.fixture
def twin() -> TwinVectorEnv:
    return TwinVectorEnv(config=TWIN, autoreset_mode=AutoresetMode.DISABLED)


@pytest.mark.parametrize("name", ["gap-mobil", "pretrained"])
def test_with_its_base_alone_the_search_drives_as_that_does_and_foresees_its_way(
    name: str, twin: TwinVectorEnv
) -> None:
    base, driver = policy(name, TWIN), load_driver(name, TWIN)
    with HighwayEnv(config=TWIN) as env:
        alone = drive(env, driver, name, 810, 12)
        search = Search(twin, base, (Plan(),))
        assert search.drive(810, 12) == pytest.approx(alone.mean_speed_m_s, abs=1e-9)
        observation, _ = env.reset(seed=810, options={"vehicles": 12})
        speeds = []
        for _ in range(HORIZON):
            observation, *_ = env.step(driver.act(env.scene, observation).number)
            speeds.append(env.scene.affordances.ego_speed_m_s)
    twin.reset(seed=810, options={"vehicles": 12})
    [way_m] = search.ways_m([search.begun(Plan())])
    # 1 s at the speeds of two steps each, so the way is at most 1 m a second off the mean speed
    assert way_m == pytest.approx(sum(speeds), abs=HORIZON)


def test_the_search_takes_the_plan_that_comes_farther(twin: TwinVectorEnv) -> None:
    def brakes(worlds: TwinVectorEnv) -> IntArray:
        return np.full(worlds.num_envs, BRAKE)

    alone, together = (
        Search(twin, brakes, plans).drive(3, 1)
        for plans in ((Plan(),), (Plan(), Plan(wait=4, brake=0), Plan(sides=(1,))))
    )
    assert alone == together  # none of these plans is faster than its base
    base = policy("gap-mobil", TWIN)
    held = Search(twin, base, (Plan(wait=HORIZON, brake=HORIZON),)).drive(810, 12)
    free = Search(twin, base, (Plan(wait=HORIZON, brake=HORIZON), Plan())).drive(810, 12)
    assert held < 11.0 < 20.0 < free


def in_lane(lane: int) -> IntArray:
    """The codes of an ego in a lane of three."""
    codes = np.zeros(CODES, np.int64)
    codes[LANE], codes[RIGHT_LANE], codes[LEFT_LANE] = lane, lane > 0, lane < 2
    return codes


USUAL, BRAKES = 4 * KEEP + ACCELERATE, 4 * KEEP + BRAKE
LEFTWARD, RIGHTWARD = 4 * LEFT + ACCELERATE, 4 * RIGHT + ACCELERATE


def test_a_plan_waits_brakes_changes_lanes_twice_and_holds() -> None:
    execution = Execution(Plan(wait=2, brake=1, sides=(1, 1), hold=1), lane=0)
    drives = [(0, False), (0, False), (0, False), (0, True), (1, False), (2, False), (2, False)]
    made = [
        execution.act(in_lane(lane), changing, RIGHTWARD if lane == 2 else USUAL)
        for lane, changing in drives
    ]
    assert made == [
        BRAKES,  # waits and brakes
        USUAL,  # waits
        LEFTWARD,
        USUAL,  # the lane change goes on by itself
        LEFTWARD,  # the second one
        USUAL,  # holds the lane, although the base wants to go right
        RIGHTWARD,
    ]


def test_a_yielding_plan_brakes_until_it_moves_and_ends_where_there_is_no_lane() -> None:
    execution = Execution(Plan(sides=(1,), yields=True), lane=1)
    assert execution.act(in_lane(1), False, USUAL) == 4 * LEFT + BRAKE
    assert execution.act(in_lane(1), True, USUAL) == USUAL
    off_road = Execution(Plan(sides=(1,)), lane=2)
    assert off_road.act(in_lane(2), False, RIGHTWARD) == RIGHTWARD


def test_a_trial_goes_on_with_a_plan_and_leaves_it_where_it_is() -> None:
    execution = Execution(Plan(wait=2), lane=1)
    execution.act(in_lane(1), False, RIGHTWARD)
    tried = deepcopy(execution)
    assert [tried.act(in_lane(1), False, 4 * RIGHT + MAINTAIN) for _ in range(2)] == [
        4 * KEEP + MAINTAIN,  # the second decision to wait
        4 * RIGHT + MAINTAIN,
    ]
    assert execution.act(in_lane(1), False, RIGHTWARD) == USUAL


def test_the_planner_is_no_base() -> None:
    config = Config().updated("simulation", world="twin").updated("safety", check="strict")
    with pytest.raises(ConfigError, match="because it searches"):
        policy("planner", config)
