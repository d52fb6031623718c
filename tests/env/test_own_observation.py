"""An observation made of named groups of indicators, or by an object of the user's own."""

import pickle
from contextlib import closing
from typing import Any

import gymnasium
import numpy as np
import pytest
from drives import ID, KEEP, RIGHT, start
from gymnasium.utils.env_checker import check_env
from worlds import CENTER, LEAVE, MERGE, ROAD, Car, ahead, behind, changing, scene
from worlds import LEFT as LEFT_LANE
from worlds import RIGHT as RIGHT_LANE

from drl_av.config import ObservationConfig
from drl_av.drivers.checked import PolicyDriver
from drl_av.driving.affordances import INDICATORS
from drl_av.driving.mirror import MIRROR, mirror_of, mirrored_observations
from drl_av.driving.observation_scale import ObservationScale
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.observation import GROUPS, GroupObservation
from drl_av.errors import ConfigError

SCALE = ObservationScale(ObservationConfig(), 30.0, ROAD)
EVERY = tuple(GROUPS)


class Speed:
    """The ego's speed alone."""

    space = gymnasium.spaces.Box(0, 40, shape=(1,), dtype=np.float32)

    def __call__(self, scene: Scene) -> np.ndarray[Any, Any]:
        return np.array([scene.affordances.ego_speed_m_s], np.float32)


class Fails(Speed):
    """Returns no number after the first scene."""

    calls = 0

    def __call__(self, scene: Scene) -> np.ndarray[Any, Any]:
        self.calls += 1
        return np.array([np.nan if self.calls > 1 else 20.0], np.float32)


class Refilled(Speed):
    """Fills the same array at each call."""

    def __init__(self) -> None:
        self.seen = np.zeros(1, np.float32)

    def __call__(self, scene: Scene) -> np.ndarray[Any, Any]:
        self.seen[:] = scene.affordances.ego_speed_m_s
        return self.seen


def test_an_object_may_fill_the_same_array_at_each_call() -> None:
    twin: Any = gymnasium.make_vec("drl_av/Highway-v0", num_envs=2, observation=Refilled())
    twin.reset(seed=1_000_000)
    seen, *_, info = twin.step(np.array([1, 3]))  # one accelerates, the other brakes hard
    assert seen[:, 0] == pytest.approx(info["speed_m_s"])
    assert seen[0, 0] != seen[1, 0]


def test_each_observation_must_lie_in_its_space() -> None:
    with closing(HighwayEnv(observation=Fails())) as env:
        env.reset(seed=1)
        with pytest.raises(ConfigError, match="or a value out of bounds, and does not lie in"):
            env.step(KEEP)


def test_the_first_seven_groups_are_the_indicators_of_the_paper() -> None:
    observe = GroupObservation(EVERY[:7], SCALE)
    world = scene(ahead(20), behind(30, LEFT_LANE))
    assert observe.names == INDICATORS
    assert np.array_equal(observe(world), SCALE(world.indicators.values[:27]))
    for made, found in zip(MIRROR, mirror_of(observe.names), strict=True):
        assert np.array_equal(made, found)


def test_a_setting_adds_the_end_of_the_lane_and_the_way_to_the_27_indicators() -> None:
    way = {"observation": {"way": True}}
    with closing(HighwayEnv("exit", config=way)) as env, closing(HighwayEnv("exit")) as plain:
        observation, info = env.reset(seed=3)
        assert env.observation_space.shape == observation.shape == (30,)
        assert np.array_equal(observation[:27], plain.reset(seed=3)[0])
        assert np.array_equal(observation[:27], env.scale(info["indicators"]))
        # three of three lane changes to the right, within 1,000 m; the lane does not end
        assert observation[27:] == pytest.approx([1, -1, 1])
        for _ in range(5):
            observation = env.step(KEEP)[0]
        assert observation[29] == pytest.approx(env.scene.affordances.mandatory.within_m / 1000)
        assert observation[29] < 0.95
    with closing(HighwayEnv("exit", config=way, observation="ego")) as env:
        assert env.observation_space.shape == (3,)


def test_groups_are_taken_in_the_order_of_their_names() -> None:
    observe = GroupObservation(("ego", "left_front"), SCALE)
    found = observe(scene(ahead(50, LEFT_LANE, 10.0), speed_m_s=30.0))
    assert observe.names[:4] == ("ego_v_x", "ego_d_y", "ego_v_y", "left_front_d_x")
    assert observe.space.shape == found.shape == (7,)
    # 30 m/s is the top of [0, 30], the centre lane is the middle, 50 m of a scale, 20 m/s slower
    config = ObservationConfig()
    expected = [1, 0, 0, 50 / config.gap_scale_m, -20 / config.speed_scale_m_s]
    assert found[:5] == pytest.approx(expected)


def test_the_names_of_groups_may_be_an_array() -> None:
    names = ["ego", "own_front"]
    with closing(HighwayEnv(observation=np.array(names))) as env:
        start(env, 2)
        assert np.array_equal(env.observation, GroupObservation(names, env.scale)(env.scene))


def test_lanes_and_lane_change_are_indicators_too() -> None:
    observe = GroupObservation(("lanes", "lane_change"), SCALE)
    assert observe.names == ("right_lane", "left_lane", "lane_change")
    assert observe(scene(y_m=RIGHT_LANE)).tolist() == [0, 1, 0]
    assert observe(changing(origin=1, target=2, seconds=2)).tolist() == [1, 1, 1]
    assert observe(changing(origin=1, target=0, seconds=2)).tolist() == [1, 1, -1]


def test_the_way_is_the_lane_changes_that_it_demands_and_their_distance() -> None:
    observe = GroupObservation(("way",), ObservationScale(ObservationConfig(), 30.0, LEAVE))
    assert observe.names == ("way_changes", "way_distance")
    # the ego's front is at 647.5 m, the exit of four lanes at 1,150 m
    leftmost = scene(s_m=645.0, y_m=11.4, road=LEAVE)
    assert observe(leftmost) == pytest.approx([-1.0, 0.5025])
    assert observe(scene(s_m=645.0, y_m=CENTER, road=LEAVE)) == pytest.approx([-1 / 3, 0.5025])
    assert observe(scene(s_m=100.0, y_m=11.4, road=LEAVE)).tolist() == [-1, 1]  # 1,047.5 m
    assert observe(scene(s_m=1149.0, y_m=CENTER, road=LEAVE)).tolist() == [0, 1]  # missed
    # before the end of a lane that is left at the left, 200 m ahead
    assert observe(scene(s_m=597.5, y_m=RIGHT_LANE, road=MERGE)) == pytest.approx([1 / 3, 0.2])
    assert GroupObservation(("way",), SCALE)(scene()).tolist() == [0, 1]
    reflected = mirrored_observations(observe(leftmost), mirror_of(observe.names))
    assert reflected == pytest.approx([1.0, 0.5025])


def test_the_mirror_of_groups_exchanges_left_and_right() -> None:
    observe = GroupObservation(EVERY[::-1], SCALE)
    mirror = mirror_of(observe.names)
    one = changing(ahead(30, LEFT_LANE, 10.0), behind(9, CENTER), origin=1, target=2, seconds=1)
    other = changing(ahead(30, RIGHT_LANE, 10.0), behind(9, CENTER), origin=1, target=0, seconds=1)
    reflected = mirrored_observations(observe(one), mirror)
    assert not np.array_equal(observe(one), observe(other))
    assert reflected == pytest.approx(observe(other), abs=1e-6)
    outermost = scene(Car(40.0, CENTER), y_m=LEFT_LANE), scene(Car(40.0, CENTER), y_m=RIGHT_LANE)
    seen = [observe(world) for world in outermost]
    assert mirrored_observations(seen[0], mirror) == pytest.approx(seen[1], abs=1e-6)


def test_one_side_alone_has_no_mirror_image() -> None:
    observe = GroupObservation(("own_front", "left_rear"), SCALE)
    with pytest.raises(ValueError, match="right_rear"):
        mirror_of(observe.names)
    assert mirror_of(("ego_v_y",)).observation_sign.tolist() == [-1]


def test_an_environment_of_groups_is_one_to_gymnasium_and_drives_as_before() -> None:
    made = gymnasium.make(ID, observation=EVERY)
    check_env(made.unwrapped, skip_render_check=True)
    env, plain = pickle.loads(pickle.dumps(made.unwrapped)), HighwayEnv()
    assert isinstance(env, HighwayEnv)
    for one in (env, plain):
        start(one, 2, seed=1)
    for action in (RIGHT, RIGHT, KEEP):
        observation, reward, *_ = env.step(action)
        expected, same, *_ = plain.step(action)
        assert np.array_equal(observation[:27], expected)
        assert reward == same
        assert env.scene.lane_change is not None
        assert observation[29] == -1
    for one in (made, env, plain):
        one.close()


def test_an_object_observes_by_itself_and_its_policy_drives_anywhere() -> None:
    with HighwayEnv(observation=Speed()) as env:
        observation, info = env.reset(seed=2)
        assert observation.tolist() == pytest.approx([info["speed_m_s"]])
        assert env.observation_space == Speed.space
        driver = PolicyDriver(lambda speed: 2 if speed[0] > 20 else 1, Speed())
        unseen = np.zeros(27, np.float32)
        assert driver.act(scene(speed_m_s=21.0), unseen).number == 2
        assert driver.act(scene(speed_m_s=19.0), unseen).number == 1


class Wrong(Speed):
    """Two numbers where its space has one."""

    def __call__(self, scene: Scene) -> np.ndarray[Any, Any]:
        return np.zeros(2, np.float32)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("own_frnt", r"no group of indicators 'own_frnt' \(did you mean 'own_front'"),
        (("ego", "ego"), "'ego' is named 2 times"),
        ((), "observation names no group; the groups are: own_front"),
        (3, "observation is 3, but must be wide, names of groups"),
        ({"ego"}, r"observation is {'ego'}, but must be wide, names .* in a list"),  # a set
        (np.mean, "an object with a gymnasium space"),
        (Wrong(), r"has the shape \(2,\) and the type float32"),
    ],
)
def test_what_is_no_observation_is_refused_in_one_sentence(given: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        HighwayEnv(observation=given).reset(seed=1)
    assert "\n" not in str(caught.value)
