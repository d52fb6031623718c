"""More experience from a decision: in the mirror, and of actions that were not taken."""

from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from decisions import decided
from worlds import LEAVE, LEFT, RIGHT, ROAD, ahead, scene

from drl_av.config import Config
from drl_av.drivers.rule_based import RandomDriver
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.affordances import INDICATORS
from drl_av.driving.mirror import Mirror
from drl_av.driving.observation_scale import ObservationScale
from drl_av.driving.scene import LaneChange
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.env.transition import Transition
from drl_av.errors import ConfigError
from drl_av.learning.experience import TransitionWriter, mirror_half, require_symmetry
from drl_av.learning.replay import TwoBuffers
from drl_av.road.road import Road
from drl_av.safety import named_check

# Three indicators: gap right, gap left, own y from the middle of the road; two actions swap.
TINY = Mirror(
    observation_permutation=np.array([1, 0, 2]),
    observation_sign=np.array([1, 1, -1], np.float32),
    action_permutation=np.array([0, 2, 1]),
)


def test_half_of_the_safe_and_half_of_the_collision_rows_are_mirrored():
    buffer = TwoBuffers(3, 10, 10, discount=0.9, collision_fraction=0.5)
    buffer.add_safe(np.array([0, 1, 0]), 1, -0.1, np.array([2, 3, 1]))
    buffer.add_collision(np.array([4, 5, 0]), 1, -5.0)
    batch = mirror_half(buffer.sample(8, np.random.default_rng(0)), TINY)
    assert batch.a_t.tolist() == [2, 1, 2, 1, 2, 1, 2, 1]
    assert batch.s_t[:, 0].tolist() == [1, 0, 1, 0, 5, 4, 5, 4]
    assert batch.s_tp1[:2].tolist() == [[3, 2, -1], [2, 3, 1]]
    assert batch.r_tp1.tolist() == [np.float32(-0.1)] * 4 + [-5.0] * 4


def test_mirroring_a_batch_leaves_the_experience_itself_alone():
    buffer = TwoBuffers(3, 10, 10, discount=0.9, collision_fraction=0.5)
    buffer.add_safe(np.array([0, 1, 0]), 1, -0.1, np.array([2, 3, 1]))
    before = buffer.state()["safe.rows"]
    mirror_half(buffer.sample(8, np.random.default_rng(0)), TINY)
    assert np.array_equal(buffer.state()["safe.rows"], before)


def test_a_lane_that_is_always_the_desired_one_is_no_road_to_mirror_unless_it_is_the_middle_one():
    def config(desired: str, lateral_m: float, mirrored: bool = True) -> Config:
        reward = {"desired": desired, "desired_lateral_m": lateral_m}
        return Config().updated("reward", **reward).updated("learning", mirrored=mirrored)

    road = Road(500.0, 3.8, (True, True, True))
    with pytest.raises(ConfigError, match="is not the middle of the road"):
        require_symmetry(config("fixed", 7.6), road)
    require_symmetry(config("fixed", 3.8), road)
    require_symmetry(config("fixed", 7.6, mirrored=False), road)
    require_symmetry(config("traffic", 7.6), road)


CONFIG = Config()
N = len(INDICATORS)
S_T = np.linspace(-1, 1, N, dtype=np.float32)
KEEP = Lateral.KEEP
MAINTAIN, ACCELERATE, BRAKE = (
    Action(KEEP, how)
    for how in (Longitudinal.MAINTAIN, Longitudinal.ACCELERATE, Longitudinal.BRAKE)
)


def ends(row: np.void) -> list[float]:
    """Action, reward and discount of a row."""
    return [row["a_t"], row["r_tp1"], row["discount"]]


def stored_after(
    before: Any,
    after: Any,
    executed: Action,
    *others: Action,
    config: Config = CONFIG,
    road: Road = ROAD,
) -> TwoBuffers:
    """The buffers after one decision on a road without SUMO."""
    scale = ObservationScale(CONFIG.observation, CONFIG.ego.max_speed_m_s, ROAD)
    env: Any = SimpleNamespace(
        config=config,
        road=road,
        safety_check=named_check(config),
        observation_of=lambda scene: scale(scene.affordances.vector()),
    )
    buffers = TwoBuffers(N, 10, 10, discount=0.9, collision_fraction=0.25)
    decision = decided(before, after, executed.number, observation=S_T)
    writer = TransitionWriter(buffers, env, np.random.default_rng(0))
    writer.add_counterfactuals(decision, others)
    return buffers


def test_an_action_that_the_check_would_replace_is_a_collision() -> None:
    # 25 m ahead, closing at 5 m/s: 25 - 3 * 5 is less than 15, and T_C is 5 s: maintain
    before = scene(ahead(25.0, speed_m_s=15.0))
    buffers = stored_after(before, scene(ahead(20.0, speed_m_s=15.0)), MAINTAIN, ACCELERATE)
    assert (len(buffers.safe), len(buffers.collision)) == (0, 1)
    row = buffers.collision.rows[0]
    assert np.array_equal(row["s_t"], S_T)
    assert ends(row) == [
        ACCELERATE.number,
        CONFIG.reward.collision_reward,
        0.0,
    ]


def test_had_it_braked_the_reward_is_that_of_18_m_s_where_19_are_wanted() -> None:
    # the vehicle ahead drives at 20 m/s, 26 m ahead, which is d_safe: v_des is 20 m/s, and no
    # lane is better. Braking ends 1.5 m further behind it at 18 m/s, where the lane allows
    # 20 + 1.5 / 8, and 1 m/s less will do
    now = scene(ahead(26.0), ahead(26.0, LEFT), ahead(26.0, RIGHT))
    buffers = stored_after(now, now, MAINTAIN, BRAKE)
    assert (len(buffers.safe), len(buffers.collision)) == (1, 0)
    row = buffers.safe.rows[0]
    r_v = np.exp(-(((20 + 1.5 / 8 - 1) - 18) ** 2) / 10) - 1
    assert ends(row) == pytest.approx([BRAKE.number, r_v / 3, 0.9], abs=1e-6)
    gap_m, speed = row["s_tp1"][0] * CONFIG.observation.gap_scale_m, row["s_tp1"][24]
    assert gap_m == pytest.approx(27.5, abs=1e-4)
    assert speed == pytest.approx((18 - 15) / 15)  # 0 at half of the ego's 30 m/s


def test_under_a_penalty_it_is_worth_what_the_check_executes_in_its_place_and_less() -> None:
    # as above: accelerating becomes maintaining, which leads to what happened: 20 m/s, 20 m behind
    # 15 m/s, 0.5 m further than the d_safe of these 15 m/s, but nearer than the ego's 26 m; 1 m/s
    # above the 15 + 0.5 / 8 that its lane allows will do
    before, after = scene(ahead(25.0, speed_m_s=15.0)), scene(ahead(20.0, speed_m_s=15.0))
    config = CONFIG.updated("learning", unsafe_penalty=0.5, speed_weight=0.6)
    buffers = stored_after(before, after, MAINTAIN, ACCELERATE, config=config)
    assert (len(buffers.safe), len(buffers.collision)) == (0, 1)
    row = buffers.collision.rows[0]
    r_v, r_x = np.exp(-((5 - 1 - 0.5 / 8) ** 2) / 10) - 1, np.exp(-36 / 260) - 1
    r_y = 0.0  # that near, rule 3 lets the ego into neither of the free lanes
    expected = (r_v + r_y + r_x) / 3 + 0.6 * 2 / 3 - 0.5
    assert ends(row) == pytest.approx([ACCELERATE.number, expected, 0.9], abs=1e-6)
    assert row["s_tp1"][0] * CONFIG.observation.gap_scale_m == pytest.approx(20.0, abs=1e-4)


def test_had_it_accelerated_while_it_braked_the_check_would_have_kept_its_speed() -> None:
    # braking led to 18 m/s; maintaining, the replacement, is 20 m/s and 1.5 m further on
    before = scene(ahead(25.0, speed_m_s=15.0))
    after = scene(ahead(21.5, speed_m_s=15.0), speed_m_s=18.0)
    config = CONFIG.updated("learning", unsafe_penalty=0.5)
    braked = stored_after(before, after, BRAKE, ACCELERATE, config=config).collision.rows[0]
    assert braked["s_tp1"][0] * CONFIG.observation.gap_scale_m == pytest.approx(20.0, abs=1e-4)
    assert braked["s_tp1"][24] == pytest.approx((20 - 15) / 15)


@pytest.mark.parametrize("penalty", [0.0, 0.5])
def test_an_unknown_outcome_is_not_stored(penalty: float) -> None:
    beside = scene(ahead(0.0, y_m=7.6))
    config = CONFIG.updated("learning", unsafe_penalty=penalty)
    buffers = stored_after(scene(), beside, MAINTAIN, BRAKE, config=config)
    assert len(buffers) == 0


@pytest.mark.parametrize("penalty", [0.0, 0.5])
def test_leaving_the_road_is_a_collision_where_no_check_forbids_it(penalty: float) -> None:
    # 1.8 m wide, 0.76 m to the right of the rightmost lane's centre: 0.24 m from the edge
    out = LaneChange(0, -1)
    before = scene(y_m=-0.76, v_y=-0.76, lane_change=out)
    further = Action(Lateral.RIGHT, Longitudinal.MAINTAIN)
    back = Action(Lateral.LEFT, Longitudinal.MAINTAIN)
    unchecked = CONFIG.updated("safety", check="permit_all")
    unchecked = unchecked.updated("learning", unsafe_penalty=penalty)
    buffers = stored_after(before, scene(y_m=0.0), back, further, config=unchecked)
    assert (len(buffers.safe), len(buffers.collision)) == (0, 1)
    buffers = stored_after(before, scene(y_m=0.0), back, back, config=unchecked)
    assert (len(buffers.safe), len(buffers.collision)) == (1, 0)


@pytest.mark.parametrize(("s_m", "safe"), [(1000.0, 1), (800.0, 0), (1140.0, 0)])
def test_a_lane_that_begins_and_parts_is_road_only_where_it_is_beside_the_ego(
    s_m: float, safe: int
) -> None:
    # the exit lane begins at 900 m and parts at 1,150 m; one decision later the ego is 20 m further
    before = scene(s_m=s_m, y_m=3.04, v_y=-0.76, lane_change=LaneChange(1, 0), road=LEAVE)
    after = scene(s_m=s_m + 20.0, y_m=3.8, road=LEAVE)
    further, back = (Action(side, Longitudinal.MAINTAIN) for side in (Lateral.RIGHT, Lateral.LEFT))
    unchecked = CONFIG.updated("safety", check="permit_all")
    buffers = stored_after(before, after, back, further, config=unchecked, road=LEAVE)
    assert (len(buffers.safe), len(buffers.collision)) == (safe, 1 - safe)


class Asked(TransitionWriter):
    """Keeps the actions whose outcomes it is asked to compute, and computes none."""

    def add_counterfactuals(self, decision: Transition, others: Iterable[Action]) -> None:
        vars(self).setdefault("asked", []).append((decision, [*others]))


@pytest.mark.parametrize("check", ["paper", "permit_all"])
def test_of_12_drawn_actions_all_are_stored_but_the_proposed_and_the_executed_one(
    check: str,
) -> None:
    config = CONFIG.updated("learning", counterfactuals=12).updated("safety", check=check)
    config = config.updated("traffic", vehicles_min=30, vehicles_max=30)
    buffer = TwoBuffers(N, 300, 300, discount=0.9, collision_fraction=0.25)
    with HighwayEnv(config=config) as env:
        store = Asked(buffer, env, np.random.default_rng(0))
        decisions = list(rollout(env, RandomDriver(), seed=1_000_000))
        for decision in decisions:
            store(decision)
    assert decisions[-1].terminated is (check == "permit_all")
    assert any(decision.triggered for decision in decisions) is (check == "paper")
    known = decisions[:-1] if decisions[-1].terminated else decisions
    assert len(buffer.safe) == len(known)
    asked = vars(store)["asked"]
    assert [decision for decision, _ in asked] == known
    for decision, others in asked:
        assert {*others} == {*ACTIONS} - {decision.proposed, decision.executed}


def test_as_many_actions_are_drawn_as_the_settings_say() -> None:
    env: Any = SimpleNamespace(config=CONFIG.updated("learning", counterfactuals=3))
    buffer = TwoBuffers(N, 300, 10, discount=0.9, collision_fraction=0.25)
    store = Asked(buffer, env, np.random.default_rng(0))
    for _ in range(200):
        store(decided())
    drawn = [others for _, others in vars(store)["asked"]]
    assert {len(others) for others in drawn} == {2, 3}  # the one that was taken may be drawn
    assert {other for others in drawn for other in others} == {*ACTIONS[1:]}
