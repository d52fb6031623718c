"""The planner: what it believes of the others, and which action it finds best."""

import pickle
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from threadpoolctl import threadpool_limits
from worlds import CENTER, LEFT, RIGHT, Car, ahead, scene, snapshot

from drl_av.config import Config
from drl_av.drivers.learned import INPUTS
from drl_av.drivers.registry import driving_config, find_drivers, load_driver, make_drivers
from drl_av.driving.actions import ACCELERATE, BRAKE, HARD_BRAKE, KEEP, MAINTAIN
from drl_av.driving.actions import LEFT as TO_LEFT
from drl_av.driving.actions import RIGHT as TO_RIGHT
from drl_av.driving.scene import Scene
from drl_av.env.beliefs import GUESSES, Beliefs
from drl_av.env.highway import HighwayEnv
from drl_av.env.planner import PlannerDriver, _libraries
from drl_av.errors import ConfigError, DrlAvWarning
from drl_av.random_streams import kind_of_traffic
from drl_av.road.snapshot import Snapshot
from drl_av.scenarios.folder import find_scenario, load_scenario, with_scenario
from drl_av.twin.worlds import ACCELERATION_M_S2, DESIRED_M_S, HEADWAY_S

STRICT = Config().updated("safety", check="strict")
NOTHING = np.zeros(0, np.float32)
ON, LEFTWARD, RIGHTWARD = (4 * side + ACCELERATE for side in (KEEP, TO_LEFT, TO_RIGHT))
ALONG = ON, 4 * KEEP + MAINTAIN, 4 * KEEP + BRAKE


def preferring(*order: int, config: Config = STRICT) -> PlannerDriver:
    """A planner whose base policy always prefers the actions in this order."""
    bias = np.full(12, -99.0, np.float32)
    bias[[*order]] = -np.arange(len(order), dtype=np.float32)
    return PlannerDriver(([(np.zeros((12, INPUTS), np.float32), bias)], config), config)


def best(planner: PlannerDriver, *others: Car, speed_m_s: float = 20.0) -> int:
    """The number of the action that it proposes to an ego in the middle lane."""
    planner.start(1)
    return planner.act(scene(*others, speed_m_s=speed_m_s), NOTHING).number


def placed(planner: PlannerDriver, world: Scene) -> Snapshot:
    """Copy a scene into the twin of a planner, whose beliefs begin with it; return its snapshot."""
    planner.start(1)
    planner._beliefs.see(world.snapshot)
    planner._place(world.snapshot, world)
    return world.snapshot


@pytest.mark.parametrize(("free", "wanted"), [(LEFT, LEFTWARD), (RIGHT, RIGHTWARD)])
def test_the_lane_that_is_free_for_half_a_minute_is_better(free: float, wanted: int) -> None:
    # The base policy stays in its lane, behind a car that drives 12 m/s now; in the free lane the
    # ego comes farther, however fast that car wants to be. A much slower one is on the other side:
    # to change to there gains nothing.
    in_vain = LEFTWARD + RIGHTWARD - wanted
    cars = ahead(80, CENTER, 12.0), ahead(70, LEFT + RIGHT - free, 4.0)
    assert best(preferring(*ALONG, wanted), *cars) == wanted
    assert best(preferring(*ALONG, in_vain, in_vain - 1, in_vain + 1), *cars) in ALONG


def test_without_a_reason_the_base_policy_decides() -> None:
    assert best(preferring(*ALONG, LEFTWARD)) == ON


def test_only_the_six_likeliest_permitted_actions_are_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # To accelerate into the right lane, where a car drives 12 m/s, is not permitted, so that the
    # sixth is to brake hard there; a car beside the ego bars all four, and the rest come by number.
    cars = ahead(80, CENTER, 12.0), ahead(60, RIGHT, 12.0)
    to_right = [4 * TO_RIGHT + part for part in range(4)]
    planner, tried = preferring(*ALONG, *to_right, LEFTWARD), []

    def ways_m(
        shot: object, plans: npt.NDArray[np.int64], guess: object, seed: object
    ) -> npt.NDArray[np.float64]:
        tried.append({tuple(plan) for plan in plans.tolist()})
        return np.zeros((len(plans), 1))

    monkeypatch.setattr(planner, "_ways_m", ways_m)
    best(planner, *cars)
    best(planner, *cars, ahead(0, RIGHT, 20.0))
    first = *ALONG, *(part for part in to_right if part != RIGHTWARD)
    second = *ALONG, LEFTWARD, 4 * KEEP + HARD_BRAKE, 4 * TO_LEFT + MAINTAIN
    assert tried == [
        {(action, held) for action in six for held in (1, 3)} for six in (first, second)
    ]


def test_a_plan_holds_its_action_for_as_many_decisions() -> None:
    # On a free road the base policy keeps 20 m/s. One decision to accelerate makes it 22 m/s for
    # all 30; three make it 22, 24 and then 26 m/s. A metre is worth 0.99 a second later, and
    # (1 - 0.99^30) / 0.01 = 26.03 seconds count: 20 x 26.03 = 520.6, 22 x 26.03 = 572.7, and
    # 22 + 24 x 0.99 + 26 x (26.03 - 1.99) = 670.8.
    planner = preferring(ALONG[1], ON)
    shot = placed(planner, scene(speed_m_s=20.0))
    plans = np.array([(ALONG[1], 1), (ON, 1), (ON, 3)])
    ways_m = planner._ways_m(shot, plans, np.zeros((2, 0), np.int64), 5)
    assert ways_m.shape == (3, 2)
    np.testing.assert_allclose(ways_m.T, [[520.6, 572.7, 670.8]] * 2, atol=0.1)


def test_the_few_best_of_the_expected_future_race_in_random_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # In the expected future the base policy comes 10 m, and the others farther if held for 1 s or
    # 3 s: to the left 14 m by 3 s, to the right 12 m by 1 s, braking 11 m and hard braking, which
    # costs 1 m a second, 11.5 m, the fourth. In six random futures the left gains 9 m and loses 1 m
    # by turns, 4 m in the mean with a standard error of 5 / sqrt(6) = 2.04 m, and the right gains
    # 3.1 m in each: it is the surer one, by 0.1 m.
    hard = 4 * KEEP + HARD_BRAKE
    planner = preferring(ON, LEFTWARD, RIGHTWARD, ALONG[2], hard)
    here = {(ON, 1): 10, (LEFTWARD, 3): 14, (RIGHTWARD, 1): 12, (ALONG[2], 1): 11, (hard, 1): 11.5}
    raced = []

    def ways_m(
        shot: object, plans: npt.NDArray[np.int64], guess: object, seed: int | None
    ) -> npt.NDArray[np.float64]:
        found = [tuple(plan) for plan in plans.tolist()]
        if seed is None:
            return np.array([[here.get(plan, 5.0)] for plan in found])
        raced.append(found)
        return np.array([[0.0] * 6, [9.0, -1.0] * 3, [3.1] * 6, [0.0] * 6])

    monkeypatch.setattr(planner, "_ways_m", ways_m)
    assert best(planner) == RIGHTWARD
    assert raced == [[(ON, 1), (LEFTWARD, 3), (RIGHTWARD, 1), (ALONG[2], 1)]]
    here = {(ON, 1): 10}
    assert best(planner) == ON  # nothing is better than the base policy, and nothing races
    assert len(raced) == 1


def test_hard_braking_costs_what_training_charged_for_each_second_that_it_is_held() -> None:
    planner, free = preferring(ALONG[1]), scene(speed_m_s=20.0)
    shot = placed(planner, free)
    plans = np.array([(4 * KEEP + HARD_BRAKE, 1), (4 * KEEP + HARD_BRAKE, 3), (ON, 3)])
    given = plans, np.zeros((1, 0), np.int64), None
    price_m = planner._ways_m(shot, *given) - planner._worth_m(shot, free, *given)
    each_m = 10.0 * STRICT.ppo.hard_brake_cost  # 10 m/s earn 1
    np.testing.assert_allclose(price_m[:, 0], [each_m, 3 * each_m, 0.0])
    assert each_m > 0


def test_each_future_has_its_guess_in_all_plans() -> None:
    # A car 40 m ahead that wants to drive 22 m/s or 30 m/s: two futures, the same for two plans.
    planner = preferring(ON)
    shot = placed(planner, scene(ahead(40, CENTER, 22.0), speed_m_s=22.0))
    wanted_m_s = np.exp(planner._beliefs._of["vehicle1"].logs[:, 0])
    guess = np.array([[abs(wanted_m_s - 22.0).argmin()], [abs(wanted_m_s - 30.0).argmin()]])
    ways_m = planner._ways_m(shot, np.array([(ON, 1), (ON, 3)]), guess, None)
    np.testing.assert_allclose(ways_m[0], ways_m[1])  # it accelerates in any case
    assert ways_m[0, 1] > ways_m[0, 0] + 5


def test_a_collision_ends_the_way_and_costs_50_m() -> None:
    # Without a check it accelerates from 20 to 22 and 24 m/s towards a car that starts 30 m ahead,
    # and hits it in the second decision: 22 + 0.99 x (about 24 - 50) m, and then nothing.
    planner = preferring(ON, config=Config().updated("safety", check="permit_all"))
    shot = placed(planner, scene(ahead(30, CENTER, 0.0), speed_m_s=20.0))
    [[way_m]] = planner._ways_m(shot, np.array([(ON, 1)]), np.zeros((1, 1), int), None)
    assert way_m == pytest.approx(22.0 + 0.99 * (23.5 - 50.0), abs=1.0)


def test_it_learns_from_the_speeds_that_come() -> None:
    planner = preferring(ALONG[1])
    planner.start(1)
    for second, speed_m_s in enumerate((22.0, 22.2, 22.3, 22.4)):  # as IDM that wants 23 m/s
        planner.act(scene(ahead(60 + 2 * second, LEFT, speed_m_s), speed_m_s=20.0), NOTHING)
    [weights, logs, _] = planner._beliefs._of["vehicle1"]
    assert weights @ np.exp(logs[:, 0]) == pytest.approx(23.0, abs=0.6)


def beliefs(*cars: Car, config: Config = STRICT) -> Beliefs:
    """Beliefs about cars, by default one 50 m ahead, in the traffic of a config on the loop."""
    loop = load_scenario(find_scenario(config.simulation.scenario))
    of = Beliefs(np.random.default_rng(3), loop, config)
    of.see(snapshot(*cars or (ahead(50),)))
    return of


def believed_m_s(of: Beliefs) -> npt.NDArray[np.float64]:
    """The desired speeds that 400 futures would give to a vehicle, the only one."""
    shot = snapshot(ahead(50))
    values, _ = of.values(shot, of.draw(np.random.default_rng(5), shot, 400))
    return values[0, :, 0]


def predicted_m_s(of: Beliefs) -> npt.NDArray[np.float64]:
    """What its guesses predict if it comes from 20 m/s a fifth nearer to its desired speed."""
    return 20.0 + 0.2 * (np.exp(of._of["vehicle1"].logs[:, 0]) - 20.0)


def test_the_desired_speed_that_explains_the_speeds_is_found() -> None:
    # A driver who wants 27.5 m/s drives 21.5 m/s. Those who want 27 or 28 m/s drive 0.1 m/s slower
    # or faster, as exactly as a prediction is weighed, so weights alone would leave a half m/s of
    # doubt; but guesses are moved to where they explain the speed to 0.01 m/s, that is 0.05 of the
    # desired speed, and spread by 0.02 of the traffic's own standard deviation.
    of = beliefs()
    traffic_m_s = believed_m_s(of)
    assert traffic_m_s.std() > 1.5
    for _ in range(3):
        of.learn("vehicle1", predicted_m_s(of), 21.5)
    assert believed_m_s(of).mean() == pytest.approx(27.5, abs=0.1)
    assert believed_m_s(of).std() < 0.15


def test_one_random_lane_change_does_not_destroy_a_belief() -> None:
    of = beliefs()
    for speed in (21.5, 21.5, 21.5, 18.0):  # then it makes room once
        of.learn("vehicle1", predicted_m_s(of), speed)
    assert believed_m_s(of).mean() == pytest.approx(27.5, abs=0.15)


def test_what_no_speed_tells_stays_as_open_as_it_was() -> None:
    # All guesses predict the same, as behind a slow vehicle, and the speed is that one or another.
    of = beliefs()
    before = of._of["vehicle1"]
    for speed in (12.0, 12.0, 9.0):
        of.learn("vehicle1", np.full(GUESSES, 12.0), speed)
    after = of._of["vehicle1"]
    np.testing.assert_allclose(after.logs, before.logs, atol=1e-12)
    np.testing.assert_allclose(after.weights, before.weights)


def test_headway_is_learned_as_the_desired_speed_is() -> None:
    of = beliefs()
    for _ in range(3):  # who keeps 1.1 s drives 18.9 m/s: a tenth of a second more, 0.3 m/s less
        predicted = 18.9 - 3.0 * (np.exp(of._of["vehicle1"].logs[:, 1]) - 1.1)
        of.learn("vehicle1", predicted, 18.9)
    weights, logs, _ = of._of["vehicle1"]
    assert weights @ np.exp(logs[:, 1]) == pytest.approx(1.1, abs=0.02)


def test_guesses_that_are_drawn_anew_keep_their_drivers_and_differ() -> None:
    of = beliefs()
    before = of._of["vehicle1"]
    predicted = np.where(np.arange(GUESSES) < 16, 20.0, 30.0)  # 16 of 128 predict it
    of.learn("vehicle1", predicted, 20.0)
    after = of._of["vehicle1"]
    np.testing.assert_allclose(after.weights, 1 / GUESSES)
    # The 16 weigh 1.02 each and the 112 others 0.02: seven eighths are drawn from the 16.
    assert np.isin(after.rows, before.rows[:16]).sum() == pytest.approx(112.5, abs=1)
    assert len(np.unique(after.logs[:, 0])) > 100


def test_the_expected_driver_wants_the_median_speed() -> None:
    of, shot = beliefs(), snapshot(ahead(50))
    for _ in range(2):
        weights, logs, _ = of._of["vehicle1"]
        [[expected]] = of.expected(shot)
        slower = weights[logs[:, 0] < logs[expected, 0]].sum()
        assert slower < 0.5 <= slower + weights[expected] + 1e-9
        of.learn("vehicle1", predicted_m_s(of), 21.5)  # unequal weights


def test_the_others_get_the_parameters_of_their_guesses() -> None:
    planner = preferring(ON)
    shot = placed(planner, scene(ahead(50), ahead(90, LEFT)))
    worlds, guess = planner._twin.fork(3, include_rng=True), np.array([[0, 1], [2, 3], [4, 5]])
    planner._beliefs.put(shot, guess, worlds)
    given = worlds.worlds.x[:, [DESIRED_M_S, HEADWAY_S, ACCELERATION_M_S2], 1:3]
    for place in range(2):
        logs = planner._beliefs._of[shot.ids[1 + place]].logs[guess[:, place]]
        np.testing.assert_allclose(given[:, :, place], np.exp(logs))


def test_the_only_truck_that_was_drawn_is_a_guess_and_not_a_certainty() -> None:
    few = STRICT.with_traffic("naturalistic").updated("traffic", truck_share=0.008)
    of = beliefs(Car(50, length_m=few.traffic.truck_length_m), config=few)
    assert len(np.unique(of._of["vehicle1"].logs[:, 0])) > 100


def test_each_vehicle_has_a_belief_of_its_own() -> None:
    of = beliefs(ahead(50), ahead(90))
    before = of._of["vehicle2"]
    of.learn("vehicle1", predicted_m_s(of), 21.5)
    assert of._of["vehicle2"] is before


def test_a_truck_is_believed_to_be_a_truck() -> None:
    hazards = STRICT.with_traffic("naturalistic")
    cars = Car(50, length_m=hazards.traffic.truck_length_m), ahead(20, LEFT)
    of, shot = beliefs(*cars, config=hazards), snapshot(*cars)
    _, rows = of.values(shot, of.draw(np.random.default_rng(5), shot, 50))
    assert of._drawn.is_truck[rows[:, 0]].all()
    assert not of._drawn.is_truck[rows[:, 1]].any()


def test_it_repeats_an_episode_in_which_it_does_not_always_do_what_its_base_would() -> None:
    config = STRICT.updated("simulation", decisions_per_episode=60)
    names = ["planner", "pretrained"]
    planner, base = make_drivers(find_drivers(names), config).values()
    with HighwayEnv(config=config) as env:

        def drive() -> tuple[float, int]:
            observation, _ = env.reset(seed=830_000, options={"vehicles": 15})
            planner.start(830_000)
            over, others = False, 0
            while not over:
                action = planner.act(env.scene, observation)
                others += action != base.act(env.scene, observation)
                observation, _, hit, over, info = env.step(action.number)
                assert not hit
            return float(info["mean_speed_m_s"]), others

        first = speed_m_s, others = drive()
        assert drive() == first
    assert speed_m_s > 20.0
    assert 0 < others < 60


def test_a_copy_from_another_process_decides_alike() -> None:
    car, planner = ahead(60, CENTER, 12.0), preferring(*ALONG, LEFTWARD)
    copy = pickle.loads(pickle.dumps(planner))
    assert best(copy, car) == best(planner, car) not in ALONG


def test_it_searches_on_one_thread_and_leaves_those_of_numpy_as_they_were(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    planner, seen = preferring(*ALONG, LEFTWARD), []
    search = planner._worth_m

    def threads() -> set[int]:
        return {each["num_threads"] for each in _libraries().info() if each["user_api"] == "blas"}

    def worth_m(*arguments: Any) -> npt.NDArray[np.float64]:
        seen.append(threads())
        return search(*arguments)

    monkeypatch.setattr(planner, "_worth_m", worth_m)
    with threadpool_limits(2, "blas"):
        best(planner, ahead(60, CENTER, 12.0))
        assert threads() == {2}
    assert seen[0] == {1}


def test_its_settings_are_those_of_its_base_policy() -> None:
    [planner, shipped] = find_drivers(["planner", "pretrained"])
    assert driving_config([planner], None) == driving_config([shipped], None)
    assert driving_config([planner], None).safety.check == "strict"


def test_in_traffic_of_several_kinds_it_plans_for_that_of_the_episode() -> None:
    several = STRICT.updated("traffic", presets=("calm", "naturalistic"))
    planner = preferring(*ALONG, config=several)
    seen = set()
    for seed in range(6):
        planner.start(seed)
        kind = kind_of_traffic(seed, several.per_traffic_preset)
        alone = preferring(*ALONG, config=kind)
        alone.start(seed)
        assert planner._kind == kind
        # only drivers of calm traffic change lanes at random
        futures = [one._twin.fork(4, seed=5).episodes.events for one in (planner, alone)]
        assert np.array_equal(*futures)
        seen.add(planner._kind.traffic.random_lane_changes_per_s > 0)
    assert seen == {True, False}


def test_under_another_check_it_warns_as_its_base_policy_does() -> None:
    with pytest.warns(DrlAvWarning, match="planner was trained under strict and relies on it"):
        load_driver("planner", Config().updated("safety", check="paper"))


def test_roads_that_the_twin_lacks_are_refused_in_a_sentence() -> None:
    merge = with_scenario(Config(), "merge").updated("safety", check="strict")
    placed = with_scenario(Config(), "cut_in").updated("safety", check="strict")
    told = "The twin does not know vehicles that a scenario places exactly: name another driver"
    with pytest.raises(ConfigError, match=told):
        load_driver("planner", placed)
    with pytest.raises(ConfigError, match="knows no roads that end"):
        load_driver("planner", merge)
    with HighwayEnv("merge", config=STRICT) as env:
        observation, _ = env.reset(seed=1)
        with pytest.raises(ConfigError, match="another road than that of the scene: give load_d"):
            load_driver("planner").act(env.scene, observation)
