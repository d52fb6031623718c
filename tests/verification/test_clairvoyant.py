"""The search that knows the future: copies of the process, plans, and what it drives."""

from collections.abc import Iterator

import pytest
from worlds import CENTER, LANE_M, LEFT, ahead, scene

from drl_av.config import Config
from drl_av.drivers.checked import PolicyDriver
from drl_av.drivers.registry import find_drivers, make_drivers
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.scene import LaneChange
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from verification.clairvoyant import BASE, HORIZON, Execution, Plan, Search, in_a_copy

SHORT = Config().updated("simulation", decisions_per_episode=30)
USUAL = Action(Lateral.KEEP, Longitudinal.ACCELERATE)
BRAKES = Action(Lateral.KEEP, Longitudinal.BRAKE)


@pytest.fixture
def env() -> Iterator[HighwayEnv]:
    made = HighwayEnv(config=SHORT)
    yield made
    made.close()


def test_a_copy_drives_on_and_the_original_stays_where_it_is(env: HighwayEnv) -> None:
    env.reset(seed=4, options={"vehicles": 8})
    before = env.scene.snapshot

    def ten_decisions_m() -> float:
        for _ in range(10):
            env.step(0)
        return float(env.scene.snapshot.s_m[0])

    first, second = in_a_copy(ten_decisions_m), in_a_copy(ten_decisions_m)
    assert env.scene.snapshot is before
    assert first == second == ten_decisions_m()
    assert first != before.s_m[0]


def test_a_copy_that_fails_is_an_error_and_says_why(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RuntimeError, match="ended without a result: correct what it printed"):
        in_a_copy(lambda: 1 / 0)
    assert "ZeroDivisionError: division by zero" in capfd.readouterr().err


def test_with_its_base_alone_the_search_drives_as_that_does_and_foresees_its_way(
    env: HighwayEnv,
) -> None:
    base = make_drivers(find_drivers([BASE]), SHORT)[BASE]
    alone = drive(env, base, BASE, 810, 12)
    search = Search(env, base, (Plan(),))
    assert search.drive(810, 12) == pytest.approx(alone.mean_speed_m_s, abs=1e-12)
    observation, _ = env.reset(seed=810, options={"vehicles": 12})
    speeds = []
    for _ in range(HORIZON):
        observation, *_ = env.step(base.act(env.scene, observation).number)
        speeds.append(env.scene.affordances.ego_speed_m_s)
    env.reset(seed=810, options={"vehicles": 12})
    search.choose(search.begun(Plan()), observation)
    # 1 s at the speeds of two steps each, so the way is at most 1 m a second off the mean speed
    assert search.found_m == pytest.approx(sum(speeds), abs=HORIZON)


def test_the_search_takes_the_plan_that_comes_farther(env: HighwayEnv) -> None:
    brakes = PolicyDriver(lambda observation: BRAKES.number)
    alone, together = (
        Search(env, brakes, plans).drive(3, 1)
        for plans in ((Plan(),), (Plan(), Plan(wait=4, brake=0), Plan(sides=(1,))))
    )
    assert alone == together  # none of these plans is faster than its base
    base = make_drivers(find_drivers([BASE]), SHORT)[BASE]
    held = Search(env, base, (Plan(wait=HORIZON, brake=HORIZON),)).drive(810, 12)
    free = Search(env, base, (Plan(wait=HORIZON, brake=HORIZON), Plan())).drive(810, 12)
    assert held < 11.0 < 20.0 < free


def test_a_plan_waits_brakes_changes_lanes_twice_and_holds() -> None:
    execution = Execution(Plan(wait=2, brake=1, sides=(1, 1), hold=1), lane=0)
    right, middle, left = (scene(y_m=lane * LANE_M) for lane in range(3))
    moving = scene(y_m=2.0, lane_change=LaneChange(0, 1))
    leftward = Action(Lateral.LEFT, Longitudinal.ACCELERATE)
    wants = Action(Lateral.RIGHT, Longitudinal.ACCELERATE)
    drives = [right, right, right, moving, middle, left, left]
    assert [execution.act(each, wants if each is left else USUAL) for each in drives] == [
        BRAKES,  # waits and brakes
        USUAL,  # waits
        leftward,
        USUAL,  # the lane change goes on by itself
        leftward,  # the second one
        USUAL,  # holds the lane, although the base wants to go right
        wants,
    ]


def test_a_yielding_plan_brakes_until_it_moves_and_ends_where_there_is_no_lane() -> None:
    execution = Execution(Plan(sides=(1,), yields=True), lane=1)
    waits = scene(ahead(20.0, y_m=LEFT), y_m=CENTER)
    moving = scene(y_m=CENTER + 1.0, lane_change=LaneChange(1, 2))
    assert execution.act(waits, USUAL) == Action(Lateral.LEFT, Longitudinal.BRAKE)
    assert execution.act(moving, USUAL) == USUAL
    off_road = Execution(Plan(sides=(1,)), lane=2)
    assert [off_road.act(scene(y_m=LEFT), ACTIONS[5])] == [ACTIONS[5]]
