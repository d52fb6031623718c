"""What is remembered of the decisions that were not made."""

from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from worlds import LEFT, RIGHT, ROAD, ahead, scene

from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.affordances import INDICATORS, ObservationScale
from drl_av.driving.scene import LaneChange, Scene
from drl_av.env.highway import HighwayEnv
from drl_av.learning import training as training_module
from drl_av.learning.buffers import TwoBuffers
from drl_av.learning.counterfactuals import remember_others
from drl_av.learning.training import Training
from drl_av.safety import named_check

CONFIG = Config()
N = len(INDICATORS)
S_T = np.linspace(-1, 1, N, dtype=np.float32)
KEEP = Lateral.KEEP
MAINTAIN, ACCELERATE, BRAKE = (
    Action(KEEP, how)
    for how in (Longitudinal.MAINTAIN, Longitudinal.ACCELERATE, Longitudinal.BRAKE)
)


def remembered(
    before: Any, after: Any, executed: Action, *others: Action, config: Config = CONFIG
) -> TwoBuffers:
    """The buffers after one decision on a road without SUMO."""
    env: Any = SimpleNamespace(
        config=config,
        road=ROAD,
        scene=after,
        safety_check=named_check(config),
        scale=ObservationScale(CONFIG.observation, CONFIG.ego.max_speed_m_s, ROAD),
    )
    buffers = TwoBuffers(N, 10, 10, discount=0.9, collision_fraction=0.25)
    remember_others(buffers, env, before, S_T, executed, others)
    return buffers


def test_an_action_that_the_check_would_replace_is_a_collision() -> None:
    # 25 m ahead, closing at 5 m/s: 25 - 3 * 5 is less than 15, and T_C is 5 s: maintain
    before = scene(ahead(25.0, speed_m_s=15.0))
    buffers = remembered(before, scene(ahead(20.0, speed_m_s=15.0)), MAINTAIN, ACCELERATE)
    assert (len(buffers.safe), len(buffers.collision)) == (0, 1)
    row = buffers.collision.rows[0]
    assert np.array_equal(row[:N], S_T)
    assert row[-3:].tolist() == [ACCELERATE.number, CONFIG.reward.collision_reward, 0.0]


def test_had_it_braked_the_reward_is_that_of_18_m_s_where_19_are_wanted() -> None:
    # the vehicle ahead drives at 20 m/s, 26 m ahead, which is d_safe: v_des is 20 m/s, and no
    # lane is better. Braking ends 1.5 m further behind it at 18 m/s, where the lane allows
    # 20 + 1.5 / 8, and 1 m/s less will do
    now = scene(ahead(26.0), ahead(26.0, LEFT), ahead(26.0, RIGHT))
    buffers = remembered(now, now, MAINTAIN, BRAKE)
    assert (len(buffers.safe), len(buffers.collision)) == (1, 0)
    row = buffers.safe.rows[0]
    r_v = np.exp(-(((20 + 1.5 / 8 - 1) - 18) ** 2) / 10) - 1
    assert row[-3:] == pytest.approx([BRAKE.number, r_v / 3, 0.9], abs=1e-6)
    gap_m, speed = row[N] * CONFIG.observation.gap_scale_m, row[N + 24]
    assert gap_m == pytest.approx(27.5, abs=1e-4)
    assert speed == pytest.approx((18 - 15) / 15)  # 0 at half of the ego's 30 m/s


def test_under_a_penalty_it_is_worth_what_the_check_executes_in_its_place_and_less() -> None:
    # as above: accelerating becomes maintaining, which leads to what happened: 20 m/s, 20 m behind
    # 15 m/s, 0.5 m further than the d_safe of these 15 m/s, but nearer than the ego's 26 m; 1 m/s
    # above the 15 + 0.5 / 8 that its lane allows will do
    before, after = scene(ahead(25.0, speed_m_s=15.0)), scene(ahead(20.0, speed_m_s=15.0))
    config = CONFIG.updated("learning", unsafe_penalty=0.5, speed_weight=0.6)
    buffers = remembered(before, after, MAINTAIN, ACCELERATE, config=config)
    assert (len(buffers.safe), len(buffers.collision)) == (0, 1)
    row = buffers.collision.rows[0]
    r_v, r_x = np.exp(-((5 - 1 - 0.5 / 8) ** 2) / 10) - 1, np.exp(-36 / 260) - 1
    r_y = 0.0  # that near, rule 3 lets the ego into neither of the free lanes
    expected = (r_v + r_y + r_x) / 3 + 0.6 * 2 / 3 - 0.5
    assert row[-3:] == pytest.approx([ACCELERATE.number, expected, 0.9], abs=1e-6)
    assert row[N] * CONFIG.observation.gap_scale_m == pytest.approx(20.0, abs=1e-4)


def test_had_it_accelerated_while_it_braked_the_check_would_have_kept_its_speed() -> None:
    # braking led to 18 m/s; maintaining, the replacement, is 20 m/s and 1.5 m further on
    before = scene(ahead(25.0, speed_m_s=15.0))
    after = scene(ahead(21.5, speed_m_s=15.0), speed_m_s=18.0)
    config = CONFIG.updated("learning", unsafe_penalty=0.5)
    braked = remembered(before, after, BRAKE, ACCELERATE, config=config).collision.rows[0]
    assert braked[N] * CONFIG.observation.gap_scale_m == pytest.approx(20.0, abs=1e-4)
    assert braked[N + 24] == pytest.approx((20 - 15) / 15)


@pytest.mark.parametrize("penalty", [0.0, 0.5])
def test_what_is_not_known_is_not_remembered(penalty: float) -> None:
    beside = scene(ahead(0.0, y_m=7.6))
    config = CONFIG.updated("learning", unsafe_penalty=penalty)
    buffers = remembered(scene(), beside, MAINTAIN, BRAKE, config=config)
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
    buffers = remembered(before, scene(y_m=0.0), back, further, config=unchecked)
    assert (len(buffers.safe), len(buffers.collision)) == (0, 1)
    buffers = remembered(before, scene(y_m=0.0), back, back, config=unchecked)
    assert (len(buffers.safe), len(buffers.collision)) == (1, 0)


def test_a_training_remembers_others_beside_those_it_made() -> None:
    def rows(counterfactuals: int) -> tuple[int, int]:
        config = CONFIG.updated("learning", counterfactuals=counterfactuals, batch_size=8)
        config = config.updated("simulation", decisions_per_episode=20)
        with HighwayEnv(config=config) as env:
            training = Training(env)
            row = training.run_episode()
        return row.decisions, len(training._buffer)

    decisions, plain = rows(0)
    more, all_others = rows(12)
    assert decisions == more == 20
    assert plain <= 2 * 20 < all_others <= 12 * 20 + 20


@pytest.mark.parametrize("check", ["paper", "permit_all"])
def test_it_asks_what_neither_proposal_nor_execution_would_have_led_to_from_the_scene_before(
    check: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Scene, Action, list[Action]]] = []

    def note(
        buffer: Any, env: Any, before: Scene, s_t: Any, executed: Action, others: Iterable[Action]
    ) -> None:
        assert env.scene is not before
        asked.append((before, executed, list(others)))

    monkeypatch.setattr(training_module, "remember_others", note)
    config = CONFIG.updated("learning", counterfactuals=12).updated("safety", check=check)
    config = config.updated("traffic", vehicles_min=30, vehicles_max=30)
    with HighwayEnv(config=config) as env:
        infos: list[dict[str, Any]] = []
        scenes: list[Scene] = []
        step = env.step

        def watched(action: int) -> Any:
            scenes.append(env.scene)
            done = step(action)
            infos.append(done[-1])
            return done

        monkeypatch.setattr(env, "step", watched)
        row = Training(env).run_episode()
    assert row.collided is (check == "permit_all")
    assert (row.safety_triggers > 0) is (check == "paper")
    assert len(asked) == row.decisions - row.collided  # what an ending led others to: unknown
    for now, info, (before, executed, others) in zip(scenes, infos, asked, strict=False):
        assert before is now
        assert executed.number == info["executed_action"]
        left_out = {info["proposed_action"], info["executed_action"]}
        assert {other.number for other in others} == set(range(12)) - left_out
