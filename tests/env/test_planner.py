"""The planner: what it believes of the others, and which action it finds best."""

import numpy as np
import numpy.typing as npt
import pytest
from worlds import CENTER, LEFT, RIGHT, Car, ahead, scene, snapshot

from drl_av.config import Config
from drl_av.drivers.masked_policy import INPUTS
from drl_av.drivers.registry import driving_config, find_drivers, load_driver, make_drivers
from drl_av.driving.actions import ACCELERATE, BRAKE, KEEP, MAINTAIN
from drl_av.driving.actions import LEFT as TO_LEFT
from drl_av.driving.actions import RIGHT as TO_RIGHT
from drl_av.env.highway import HighwayEnv
from drl_av.env.planner import GUESSES, Beliefs, PlannerDriver
from drl_av.errors import ConfigError, DrlAvWarning
from drl_av.scenarios.folder import find_scenario, load_scenario, with_scenario

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


@pytest.mark.parametrize(("free", "wanted"), [(LEFT, LEFTWARD), (RIGHT, RIGHTWARD)])
def test_the_lane_that_is_free_for_half_a_minute_is_better(free: float, wanted: int) -> None:
    # The base policy stays in its lane: behind the car at 12 m/s it comes 300 m ahead of where the
    # ego is now plus the gap, in the free lane twice as far. A car just as slow is on the other
    # side: a change to there gains nothing.
    in_vain = LEFTWARD + RIGHTWARD - wanted
    cars = ahead(80, CENTER, 12.0), ahead(60, LEFT + RIGHT - free, 12.0)
    assert best(preferring(*ALONG, wanted), *cars) == wanted
    assert best(preferring(*ALONG, in_vain), *cars) in ALONG


def test_without_a_reason_the_base_policy_decides() -> None:
    assert best(preferring(*ALONG, LEFTWARD)) == ON


def test_an_improbable_action_is_not_tried() -> None:
    cars = ahead(80, CENTER, 12.0), ahead(60, RIGHT, 12.0)
    planner = preferring(*ALONG, LEFTWARD)
    planner._layers[0][1][LEFTWARD] = -20.0  # e^-20 times as probable as the best
    assert best(planner, *cars) in ALONG


def beliefs(config: Config = STRICT) -> Beliefs:
    """Beliefs about the traffic of a config on the loop."""
    loop = load_scenario(find_scenario(config.simulation.scenario))
    return Beliefs(np.random.default_rng(3), loop, config)


def mean_m_s(of: Beliefs, desired: npt.NDArray[np.float64], shot_of: Car) -> float:
    """The mean desired speed that the vehicle is believed to have."""
    drawn = of.draw(np.random.default_rng(5), snapshot(shot_of), 400)
    return float(desired[drawn].mean())


def test_the_guess_that_predicts_a_speed_is_believed() -> None:
    of, car = beliefs(), ahead(50)
    of.see(snapshot(car))
    predicted = np.linspace(20.0, 32.0, GUESSES)  # guess k predicts 20 + 12 k / 127 m/s
    assert mean_m_s(of, predicted, car) == pytest.approx(26.0, abs=0.5)  # all alike
    of.learn("vehicle1", predicted, 23.0)
    # Among 128 guesses a distance of 0.1 m/s has 2.1 guesses on each side: they weigh 1.02 and
    # less, the other 123 weigh 0.02 each, so the mean is drawn to 26 by a third.
    once = mean_m_s(of, predicted, car)
    assert 23.0 < once < 25.5
    of.learn("vehicle1", predicted, 23.0)
    assert mean_m_s(of, predicted, car) == pytest.approx(23.0, abs=0.15)


def test_one_random_lane_change_does_not_destroy_a_belief() -> None:
    of, car = beliefs(), ahead(50)
    of.see(snapshot(car))
    predicted = np.linspace(20.0, 32.0, GUESSES)
    for speed in (23.0, 23.0, 23.0, 29.0):  # then it makes room once
        of.learn("vehicle1", predicted, speed)
    assert mean_m_s(of, predicted, car) == pytest.approx(23.0, abs=0.3)


def test_a_truck_is_believed_to_be_a_truck() -> None:
    hazards = STRICT.with_traffic("naturalistic")
    of, truck = beliefs(hazards), Car(50, length_m=hazards.traffic.truck_length_m)
    of.see(snapshot(truck, ahead(20, LEFT)))
    is_truck = of._guesses.is_truck
    drawn = of.draw(np.random.default_rng(5), snapshot(truck, ahead(20, LEFT)), 50)
    assert is_truck[drawn[:, 0]].all()
    assert not is_truck[drawn[:, 1]].any()


def test_it_comes_farther_than_its_base_policy_and_repeats_itself() -> None:
    config = STRICT.updated("simulation", decisions_per_episode=60)
    drivers = make_drivers(find_drivers(["planner", "pretrained"]), config)
    with HighwayEnv(config=config) as env:

        def speed_m_s(name: str) -> float:
            observation, _ = env.reset(seed=830_000, options={"vehicles": 15})
            drivers[name].start(830_000)
            over = False
            while not over:
                action = drivers[name].act(env.scene, observation)
                observation, _, hit, over, info = env.step(action.number)
                assert not hit
            return float(info["mean_speed_m_s"])

        found = speed_m_s("planner")
        assert found > speed_m_s("pretrained")
        assert speed_m_s("planner") == found


def test_its_settings_are_those_of_its_base_policy() -> None:
    [planner, shipped] = find_drivers(["planner", "pretrained"])
    assert driving_config([planner], None) == driving_config([shipped], None)
    assert driving_config([planner], None).safety.check == "strict"


def test_under_another_check_it_warns_as_its_base_policy_does() -> None:
    with pytest.warns(DrlAvWarning, match="planner was trained under strict and relies on it"):
        load_driver("planner", Config().updated("safety", check="paper"))


def test_roads_that_the_twin_lacks_are_refused_in_a_sentence() -> None:
    merge = with_scenario(Config(), "merge").updated("safety", check="strict")
    with pytest.raises(ConfigError, match="knows no roads that end"):
        load_driver("planner", merge)
