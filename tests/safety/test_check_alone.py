"""The check around drivers and agents that know nothing of it, on real SUMO."""

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import gymnasium
import numpy as np
import pytest

from drl_av.config import Config
from drl_av.drivers.checked import PolicyDriver, SteadyDriver
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.errors import ConfigError
from drl_av.safety import CHECKS, action_mask, named_check
from drl_av.safety.check import Rule, Verdict, Verdicts, WholeCheck, apply_check, permit_all
from drl_av.safety.paper import Paper

ID = "drl_av/Highway-v0"
SHORT = Config().updated("simulation", decisions_per_episode=40)


@pytest.fixture(scope="module")
def env() -> Iterator[gymnasium.Env]:  # type: ignore[type-arg]
    with closing(gymnasium.make(ID, config=SHORT)) as env:
        yield env


def test_the_mask_of_an_info_tells_what_the_next_step_will_execute(env: gymnasium.Env) -> None:  # type: ignore[type-arg]
    rng, verdicts = np.random.default_rng(4), []
    for seed in range(6):
        _, info = env.reset(seed=seed, options={"vehicles": 30})
        over = False
        while not over:
            mask, action = info["action_mask"], int(rng.integers(12))
            assert (mask.dtype, mask.shape) == (np.int8, (12,))
            _, _, terminated, truncated, info = env.step(action)
            assert mask[action] == (info["executed_action"] == action)
            verdicts.append((bool(mask[action]), mask.tolist() == info["action_mask"].tolist()))
            over = terminated or truncated
    # the mask differs from step to step, so that one of another moment would have failed
    assert {permitted for permitted, _ in verdicts} == {True, False}
    assert sum(not same for _, same in verdicts) > 20


def test_an_agent_that_samples_under_the_mask_fires_no_rule(env: gymnasium.Env) -> None:  # type: ignore[type-arg]
    _, info = env.reset(seed=3, options={"vehicles": 25})
    env.action_space.seed(3)
    for _ in range(40):
        *_, info = env.step(env.action_space.sample(info["action_mask"]))
        assert info["rule"] == "none"


def test_sb3_contrib_finds_the_mask_through_wrappers(env: gymnasium.Env) -> None:  # type: ignore[type-arg]
    _, info = env.reset(seed=5, options={"vehicles": 25})
    assert np.array_equal(env.get_wrapper_attr("action_masks")(), info["action_mask"])


def test_only_who_asks_for_the_mask_pays_for_it() -> None:
    def never(scene: object, action: object) -> None:
        raise AssertionError("the check must not be asked")

    with closing(HighwayEnv(config=SHORT, safety_check=never)) as bare:  # type: ignore[arg-type]
        assert "action_mask" not in bare.reset(seed=1)[1]


@pytest.mark.parametrize(
    "returned", [None, ACTIONS[0], 3, Verdict(3, Rule.NONE), Verdict(ACTIONS[0], 7)]
)  # type: ignore[arg-type]
def test_a_check_that_returns_no_verdict_is_refused_in_one_sentence(returned: Any) -> None:
    with closing(HighwayEnv(config=SHORT, safety_check=lambda scene, proposed: returned)) as env:
        env.reset(seed=1)
        for asked in (lambda: env.step(0), env.action_masks):
            with pytest.raises(ConfigError, match=r"check returned .*, but must return a Verdict"):
                asked()


def test_a_check_that_replaces_an_action_and_names_no_rule_is_refused() -> None:
    brakes = Verdict(ACTIONS[3], Rule.NONE)
    with closing(HighwayEnv(config=SHORT, safety_check=lambda scene, proposed: brakes)) as env:
        env.reset(seed=1)
        assert env.step(3)[-1]["rule"] == "none"
        with pytest.raises(ConfigError, match=r"replaced the action .*, but named no rule: return"):
            env.step(0)


def test_a_check_that_names_a_rule_and_keeps_the_action_has_permitted_it() -> None:
    kept = Verdict(ACTIONS[3], Rule.IN_LANE)
    with closing(HighwayEnv(config=SHORT, safety_check=lambda scene, proposed: kept)) as env:
        env.reset(seed=1)
        info = env.step(3)[-1]
        assert (info["rule"], info["executed_action"]) == ("none", 3)
        assert (env.step(0)[-1]["rule"], env.action_masks().tolist()) == ("in_lane", MASK_OF_3)


class AlwaysBrakes(Paper):
    """A user's check that takes the paper's rules for a beginning, and brakes."""

    def __init__(self) -> None:
        super().__init__(Config().safety)

    def __call__(self, scene: Scene, proposed: Action) -> Verdict:
        return Verdict(ACTIONS[3], "always brake")


def test_what_a_check_of_the_user_does_for_one_action_counts_for_all() -> None:
    with closing(HighwayEnv(config=SHORT, safety_check=AlwaysBrakes())) as env:
        env.reset(seed=1)
        assert env.action_masks().tolist() == MASK_OF_3
        assert action_mask(env.safety_check, env.scene).tolist() == MASK_OF_3
        info = env.step(1)[-1]
        assert (info["executed_action"], info["rule"]) == (3, "always brake")
        assert env.check_name == "AlwaysBrakes"


class Whole(WholeCheck):
    """A user's check that replaces each action by the third."""

    def __init__(self, executed: object, rules: object) -> None:
        self.found: Any = executed, rules

    def verdicts(self, scene: Scene) -> Verdicts:
        found: Verdicts = self.found
        return found


def test_a_check_of_all_actions_that_names_a_rule_and_keeps_the_action_has_permitted_it() -> None:
    with closing(HighwayEnv(config=SHORT, safety_check=Whole([3] * 12, [1] * 12))) as env:
        env.reset(seed=1)
        assert [env.step(action)[-1]["rule"] for action in (3, 0, 3)] == ["none", "in_lane", "none"]
        assert env.step(3)[-1]["safety_triggers"] == 1


@pytest.mark.parametrize(
    ("executed", "rules"),
    [
        ([3] * 12, [0] * 12),  # eleven actions are replaced by no rule
        ([3] * 12, [9] * 12),
        ([12] * 12, [1] * 12),
        ([-1] * 12, [1] * 12),
        ([3.0] * 12, [1] * 12),
        ([3] * 11, [1] * 11),
        (None, None),
    ],
)
def test_a_check_of_all_actions_that_returns_no_verdicts_is_refused(
    executed: object, rules: object
) -> None:
    with closing(HighwayEnv(config=SHORT, safety_check=Whole(executed, rules))) as env:
        env.reset(seed=1)
        for asked in (lambda: env.step(0), env.action_masks):
            with pytest.raises(
                ConfigError, match=r"returned the verdicts .*, but must return, for"
            ):
                asked()


def test_a_check_cannot_write_the_scene_with_which_the_world_goes_on() -> None:
    """One that rolls forward in place would be told of another world than it drives in."""

    def rolls(scene: Scene, proposed: Action) -> Verdict:
        scene.snapshot.s_m[0] += 30.0
        raise AssertionError("the scene was written")

    with closing(HighwayEnv(config=SHORT, safety_check=rolls)) as env:
        env.reset(seed=1)
        for asked in (lambda: env.step(0), env.action_masks):
            with pytest.raises(ValueError, match="read-only"):
                asked()
        assert env.scene.snapshot.s_m.flags.writeable


class Rolls(WholeCheck):
    """A driver, an observation and a check that rolls forward in place."""

    space = gymnasium.spaces.Discrete(2)

    def act(self, scene: Scene, observation: object = None) -> Action:
        scene.snapshot.s_m[1:] += 30.0
        raise AssertionError("the scene was written")

    start = verdicts = __call__ = act  # type: ignore[assignment]


def test_nothing_of_the_user_s_can_write_the_scene() -> None:
    rolls, whole = Rolls(), type("Whole", (WholeCheck,), {"verdicts": Rolls.act})()
    reward = {"reward": lambda made: rolls.act(made.next_scene)}
    rolls.start = lambda seed: None  # type: ignore[method-assign]
    steady = SteadyDriver(rolls, permit_all, SHORT.updated("driver", hold_s=2.0))
    keep: Any = PolicyDriver(lambda observation: 0)
    parts = {"safety_check": whole}, {"observation": rolls}, reward, {}, {}
    for own, driver in zip(parts, (keep, keep, keep, rolls, steady), strict=True):
        env, refused = HighwayEnv(config=SHORT, **own), pytest.raises(ValueError, match="read-only")
        with closing(env), refused:
            drive(env, driver, "mine", 1, 5)


def test_a_rule_may_have_any_name() -> None:
    named = Verdict(ACTIONS[3], " too close \x1b[31m")
    with closing(HighwayEnv(config=SHORT, safety_check=lambda scene, proposed: named)) as env:
        env.reset(seed=1)
        assert env.step(0)[-1]["rule"] == r"too close \x1b[31m"
        assert env.step(3)[-1]["rule"] == "none"


MASK_OF_3 = [0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0]


def test_workers_tell_their_masks_together() -> None:
    kwargs = {"context": "spawn"}
    vector = gymnasium.make_vec(ID, 2, "async", vector_kwargs=kwargs, config=SHORT)
    try:
        _, info = vector.reset(seed=[1, 2])
    finally:
        vector.close()
    with closing(HighwayEnv(config=SHORT, action_mask=True)) as alone:
        masks = [alone.reset(seed=seed)[1]["action_mask"].tolist() for seed in (1, 2)]
    assert info["action_mask"].tolist() == masks


def test_an_agent_of_stable_baselines3_drives_under_the_check() -> None:
    # imported here: torch comes along, and workers that import this file do without it
    from stable_baselines3 import DQN

    calm = SHORT.with_traffic("calm")
    with closing(HighwayEnv(config=calm)) as env:
        model = DQN("MlpPolicy", env, learning_starts=20, buffer_size=100, seed=1, device="cpu")
        model.learn(60)
        agent = PolicyDriver(lambda affordances: model.predict(affordances, deterministic=True)[0])
        for seed in range(3):
            result = drive(env, agent, "dqn", seed, 30)
            assert not result.ego_hit
        observation, _ = env.reset(seed=9, options={"vehicles": 30})
        mask = action_mask(named_check(calm), env.scene)
        action = agent.act(env.scene, observation)
        executed = apply_check(env.safety_check, env.scene, action).action
        assert (executed == action) == mask[action.number]
        assert action in ACTIONS


def test_a_check_from_outside_the_package_is_one_line_of_the_registry(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def timid(scene: Scene, proposed: Action) -> Verdict:
        executed = Action(Lateral.KEEP, Longitudinal.BRAKE)
        return Verdict(executed, Rule.NONE if executed == proposed else Rule.IN_LANE)

    monkeypatch.setitem(CHECKS, "timid", lambda config, vehicle_types, road: timid)
    with closing(HighwayEnv(safety_check="timid")) as env:
        env.reset(seed=1, options={"vehicles": 3})
        info = env.step(5)[4]
        assert (info["proposed_action"], info["executed_action"]) == (5, 2)
        assert info["rule"] == "in_lane"
        assert env.check_name == "timid"
