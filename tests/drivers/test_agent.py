"""Agents of stable-baselines3: no code of a zip runs unseen, and preprocessing is never lost."""

import base64
import io
import json
import pickle
import warnings
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import NormalizeObservation, RescaleObservation
from programs import Bomb, python
from runs import Capsys, error_message
from stable_baselines3 import A2C, DQN, PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize
from worlds import ALONE

import drl_av
from drl_av.cli import main
from drl_av.config import Config
from drl_av.drivers.agent import driver_of_agent
from drl_av.drivers.safe_pickle import Unpickler
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.observation import GROUPS
from drl_av.errors import CheckpointError, DrlAvWarning
from drl_av.safety.check import permit_all
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.loop import ScenarioDescription

SHORT = Config().updated("simulation", decisions_per_episode=8)
RNG = np.random.default_rng(5)


def loaded(path: Path, space: Any = None) -> Any:
    return driver_of_agent(path, Config(), space, lambda: permit_all)


def refused(path: Path, sentence: str, space: Any = None) -> None:
    with pytest.raises(CheckpointError, match=sentence):
        loaded(path, space)


def untrained(env: Any, path: Path, policy: str = "MlpPolicy") -> Path:
    """The file of an agent that has the spaces of an environment, and has learned nothing."""
    with env:
        PPO(policy, env, device="cpu", n_steps=2, batch_size=2).save(path)
    return path


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return untrained(HighwayEnv(config=SHORT), tmp_path_factory.mktemp("agents") / "agent.zip")


def changed(source: Path, target: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """A copy of an agent's file with another description."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "data":
                described = json.loads(data)
                change(described)
                data = json.dumps(described).encode()
            new.writestr(name, data)
    return target


def pickled(value: object) -> dict[str, str]:
    return {":type:": "x", ":serialized:": base64.b64encode(pickle.dumps(value)).decode()}


def rigged(source: Path, mark: Path, part: str = "policy_kwargs") -> Path:
    """A copy beside the mark that leaves it where it is unpickled."""
    bomb = {part: pickled(Bomb(mark))}
    return changed(source, mark.with_name("a.zip"), lambda data: data.update(bomb))


@pytest.mark.parametrize("part", ["observation_space", "action_space", "lr_schedule", "clip_range"])
def test_a_bomb_in_a_part_that_needs_no_code_never_explodes(
    part: str, saved: Path, tmp_path: Path
) -> None:
    mark = tmp_path / "exploded"
    path = rigged(saved, mark, part)
    if part.endswith("space"):
        refused(path, f"has no readable {part} ")
    else:
        loaded(path).act(ALONE, np.zeros(27, np.float32))
    assert not mark.exists()


def test_who_loads_classes_of_the_file_is_warned_before(saved: Path, tmp_path: Path) -> None:
    mark = tmp_path / "exploded"
    path = rigged(saved, mark)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DrlAvWarning)
        with pytest.raises(DrlAvWarning, match=r"loaded by running code that it names .*Ctrl-C"):
            loaded(path)
    assert not mark.exists()
    with pytest.warns(DrlAvWarning):
        loaded(path)
    assert mark.exists(), "the bomb is a dud"


@pytest.mark.parametrize(
    "words",
    [
        "adapt {zip} --out new",
        "export {zip} new.onnx",
        "evaluate {zip} --vehicles 100000 --episodes 1",
        "evaluate {zip} idm --safety-check strict --scenario {dir}",
        "evaluate {zip} --driver {dir} --vehicles 1 --episodes 1",
        "replay {zip} --vehicles 100000 --video v.gif",
        "figures {zip}",
        "train --out new --config {zip}",
    ],
)
def test_no_verb_unpickles_what_it_refuses(
    words: str, saved: Path, here: Path, capsys: Capsys
) -> None:
    mark = here / "exploded"
    path = rigged(saved, mark)
    (here / "empty").mkdir()
    assert main(words.format(zip=path, dir=here / "empty").split()) == 1
    error_message(capsys)
    assert not mark.exists()


@pytest.mark.parametrize("verb", ["evaluate", "replay"])
def test_the_help_says_what_a_zip_can_do(verb: str, capsys: Capsys) -> None:
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    assert "runs no code in them, except for" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("agent", [A2C, DQN, PPO])
def test_an_agent_without_code_of_its_own_is_read_without_any(
    agent: type[PPO], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import torch

    kwargs = {"net_arch": [32, 16], "activation_fn": torch.nn.ELU}
    with HighwayEnv(config=SHORT) as env:
        model = agent("MlpPolicy", env, device="cpu", policy_kwargs=kwargs)
        model.save(tmp_path / "a.zip")

    def never(*arguments: object, **named: object) -> None:
        raise AssertionError("this can run any code")

    monkeypatch.setattr("cloudpickle.loads", never)
    monkeypatch.setattr(pickle, "loads", never)
    driver = loaded(tmp_path / "a.zip")
    for observation in RNG.uniform(-1, 1, (9, 27)).astype(np.float32):
        wanted = int(model.predict(observation, deterministic=True)[0])
        assert driver.act(ALONE, observation).number == wanted


@pytest.mark.parametrize("word", ["os:system", "builtins:exec", "torch.optim.adam:Adam.__init__"])
def test_a_pickle_may_not_name_other_things(word: str) -> None:
    found, name = word.split(":")
    with pytest.raises(pickle.UnpicklingError):
        Unpickler(io.BytesIO()).find_class(found, name)


def test_an_encrypted_zip_and_a_bomb_are_one_sentence(saved: Path, tmp_path: Path) -> None:
    data = bytearray(saved.read_bytes())
    for signature, offset in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        place = -1
        while (place := data.find(signature, place + 1)) >= 0:
            data[place + offset] |= 1
    (tmp_path / "encrypted.zip").write_bytes(data)
    refused(tmp_path / "encrypted.zip", r"\(it is encrypted\): give the file")
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data", "{}")
        with archive.open("policy.pth", "w") as part:
            for _ in range(501):
                part.write(bytes(10**6))
    refused(tmp_path / "bomb.zip", "it unpacks to more than 500 MB")


def test_a_small_file_that_asks_for_a_huge_network_gets_none(saved: Path, tmp_path: Path) -> None:
    huge = {"policy_kwargs": {"net_arch": [100_000, 100_000]}}
    path = changed(saved, tmp_path / "a.zip", lambda data: data.update(huge))
    refused(path, "layers of 100000, 100000 units, which need more")


def learned(env: Any, path: Path, policy: str = "MlpPolicy") -> PPO:
    """An agent after a short training, which is saved."""
    model = PPO(policy, env, device="cpu", n_steps=16, batch_size=8, n_epochs=1, seed=1)
    model.learn(16)
    model.save(path)
    return model


def trained(wrap: Callable[[Any], Any], path: Path) -> tuple[PPO, Any]:
    env = wrap(HighwayEnv(config=SHORT))
    model = learned(env, path)
    env.close()
    return model, env


def test_statistics_beside_the_zip_are_used_and_missing_ones_are_asked_for(tmp_path: Path) -> None:
    model, env = trained(lambda e: VecNormalize(DummyVecEnv([lambda: e])), tmp_path / "a.zip")
    refused(tmp_path / "a.zip", r"with VecNormalize, .* beside it as .*vecnormalize")
    env.save(tmp_path / "vecnormalize.pkl")
    driver, differ = loaded(tmp_path / "a.zip"), 0
    for observation in RNG.uniform(-1, 1, (200, 27)).astype(np.float32):
        wanted = int(model.predict(env.normalize_obs(observation), deterministic=True)[0])
        assert driver.act(ALONE, observation).number == wanted
        differ += wanted != int(model.predict(observation, deterministic=True)[0])
    assert differ > 0, "raw observations would do as well"


def test_normalized_observations_within_the_bounds_are_not_taken_for_raw(tmp_path: Path) -> None:
    # of DQN the zip holds the raw and the normalized observation, with VecNormalize and without
    with closing(HighwayEnv(config=SHORT)) as env:
        normalized = VecNormalize(DummyVecEnv([lambda: env]), clip_obs=0.9)
        for name, seen in (("normalized", normalized), ("raw", env)):
            model = DQN("MlpPolicy", seen, device="cpu", learning_starts=99, buffer_size=99, seed=1)
            model.learn(20)
            model.save(tmp_path / f"{name}.zip")
    loaded(tmp_path / "raw.zip")
    refused(tmp_path / "normalized.zip", "was trained with VecNormalize, whose statistics")


def test_statistics_that_run_code_are_refused(tmp_path: Path) -> None:
    trained(lambda e: VecNormalize(DummyVecEnv([lambda: e])), tmp_path / "a.zip")
    mark = tmp_path / "exploded"
    (tmp_path / "vecnormalize.pkl").write_bytes(pickle.dumps(Bomb(mark)))
    refused(tmp_path / "a.zip", r"vecnormalize\.pkl holds no statistics of VecNormali")
    assert not mark.exists()


def test_statistics_of_another_agent_are_left_alone_with_a_word(tmp_path: Path) -> None:
    trained(lambda e: e, tmp_path / "raw.zip")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        loaded(tmp_path / "raw.zip")
    (tmp_path / "vecnormalize.pkl").write_bytes(b"of another agent")
    with pytest.warns(DrlAvWarning, match=r"so it observes raw .*vecnormalize\.pkl are not used"):
        loaded(tmp_path / "raw.zip")


def test_an_agent_of_normalized_observations_without_statistics_is_refused(tmp_path: Path) -> None:
    trained(NormalizeObservation, tmp_path / "a.zip")
    refused(tmp_path / "a.zip", r"outside the bounds .* NormalizeObservation makes")


def test_an_agent_of_the_wide_observation_is_told_to_drive_with_it(tmp_path: Path) -> None:
    path = untrained(HighwayEnv(observation="wide"), tmp_path / "a.zip")
    refused(path, r"shape \(132,\) .*: drive with --observation wide \(observation=\), as")


class Gaps:
    """Three gaps: no indicator of a usual observation stands at its usual place."""

    space = gymnasium.spaces.Box(-250.0, 250.0, (3,), np.float32)

    def __call__(self, scene: Scene) -> Any:
        return scene.indicators.values[:27][:9:4].astype(np.float32) - 200.0


class Named(Gaps):
    """The same as a dictionary."""

    space = gymnasium.spaces.Dict({"gaps": Gaps.space})

    def __call__(self, scene: Scene) -> Any:
        return {"gaps": super().__call__(scene)}


class Unbounded(Gaps):
    """The same without bounds, as most users write it."""

    space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)


class Lane(Gaps):
    """The number of the ego's lane."""

    space = gymnasium.spaces.Discrete(4)

    def __call__(self, scene: Scene) -> Any:
        return scene.affordances.lane


OBSERVATIONS = Gaps(), Named(), Unbounded(), Lane(), ("ego", "own_front", "own_rear"), "wide"


@pytest.mark.parametrize("observation", OBSERVATIONS, ids=range(6))
def test_an_agent_of_any_observation_drives_with_it(observation: Any, tmp_path: Path) -> None:
    with HighwayEnv(config=SHORT, observation=observation) as env:
        policy = "MultiInputPolicy" if isinstance(observation, Named) else "MlpPolicy"
        model = learned(env, tmp_path / "a.zip", policy)
        drives = {"config": SHORT, "vehicles": 5, "safety_check": "permit_all", "jobs": 1}
        found = drl_av.evaluate(tmp_path / "a.zip", observation=observation, **drives)
        seen, _ = env.reset(seed=found[0].seed, options={"vehicles": 5})
        rewards, over = [], False
        while not over:
            action = int(model.predict(seen, deterministic=True)[0])
            seen, reward, terminated, truncated, _ = env.step(action)
            rewards.append(reward)
            over = terminated or truncated
    assert found[0].mean_reward == pytest.approx(np.mean(rewards), rel=1e-12)


def test_statistics_of_an_observation_without_bounds_are_used_or_asked_for(tmp_path: Path) -> None:
    for kind, policy in ((Unbounded(), "MlpPolicy"), (Named(), "MultiInputPolicy")):
        env = VecNormalize(DummyVecEnv([lambda k=kind: HighwayEnv(config=SHORT, observation=k)]))
        model = learned(env, tmp_path / "p.zip", policy)
        env.save(tmp_path / "vecnormalize.pkl")
        env.close()
        driver = loaded(tmp_path / "p.zip", kind.space)
        for _ in range(50):
            seen = kind.space.sample() if kind.space.shape is None else RNG.normal(size=3) * 50
            seen = seen if isinstance(seen, dict) else seen.astype(np.float32)
            wanted = int(model.predict(env.normalize_obs(seen), deterministic=True)[0])
            assert driver.act(ALONE, seen).number == wanted
        other = DQN(policy, HighwayEnv(config=SHORT, observation=kind), learning_starts=4)
        other.learn(8)
        other.save(tmp_path / "q.zip")
        refused(tmp_path / "q.zip", "does not tell whether it was trained with VecN", kind.space)


def test_a_dictionary_with_other_keys_is_another_observation(tmp_path: Path) -> None:
    untrained(HighwayEnv(observation=Named()), tmp_path / "a.zip", "MultiInputPolicy")
    for here in ({"other": Gaps.space}, {"gaps": gymnasium.spaces.Box(-1, 1, (4,))}):
        space = gymnasium.spaces.Dict(here)
        refused(tmp_path / "a.zip", r"with Dict\('gaps': .*, but drives with Dict\(", space)


@pytest.mark.parametrize("most", [0.0, -1.0])
def test_an_agent_of_rescaled_observations_is_refused(tmp_path: Path, most: float) -> None:
    """A wrapper that keeps the shape changes the bounds alone."""
    bounds = np.float32(most), np.float32(1.0)
    path = untrained(RescaleObservation(HighwayEnv(config=SHORT), *bounds), tmp_path / "a.zip")
    refused(path, "that does what its wrapper did, such as RescaleObservation")
    own = HighwayEnv(config=SHORT, observation=Gaps())
    path = untrained(RescaleObservation(own, *bounds), tmp_path / "b.zip")
    refused(path, r"was trained with Box\(.*, but drives with Box\(-250", Gaps.space)


@pytest.mark.parametrize("setting", ["gap_scale_m", "speed_scale_m_s", "range_m"])
def test_an_agent_that_has_another_scaling_is_refused(setting: str, tmp_path: Path) -> None:
    scaled = HighwayEnv(config=SHORT.updated("observation", **{setting: 50.0}))
    path = untrained(scaled, tmp_path / "a.zip")
    refused(path, r"repeat the settings of \[observation\] or the groups")


def test_an_agent_of_the_same_indicators_in_another_order_is_refused(tmp_path: Path) -> None:
    env = HighwayEnv(config=SHORT, observation=("ego", *[*GROUPS][:6]))
    refused(untrained(env, tmp_path / "a.zip"), r"or the groups of its training")


def test_an_agent_of_a_road_with_more_lanes_drives_on_another(tmp_path: Path) -> None:
    write_scenario(tmp_path / "wide", ScenarioDescription(lanes=4, circumference_m=600.0))
    env = HighwayEnv(tmp_path / "wide", config=SHORT)
    assert env.observation_space.high[25] == pytest.approx(2 * env.road.lane_width_m / 3.8)
    loaded(untrained(env, tmp_path / "a.zip")).act(ALONE, np.zeros(27, np.float32))


def test_an_agent_of_another_observation_is_told_to_name_its_own(tmp_path: Path) -> None:
    two = HighwayEnv(config=SHORT, observation=("ego", "own_front"))
    path = untrained(two, tmp_path / "a.zip")
    refused(path, r"observation of its training \(evaluate --ob")
    way = HighwayEnv(config=SHORT.updated("observation", way=True))
    refused(untrained(way, tmp_path / "b.zip"), r"set observation\.way as in its training")


def test_stacked_frames_have_a_remedy_that_helps(tmp_path: Path) -> None:
    trained(lambda e: VecFrameStack(DummyVecEnv([lambda: e]), 4), tmp_path / "a.zip")
    with pytest.raises(CheckpointError) as error:
        loaded(tmp_path / "a.zip")
    assert "4 stacked observations, so give a factory module:function" in str(error.value)
    assert "observation.way" not in str(error.value)


def test_gymnasium_stacks_frames_in_another_shape(tmp_path: Path) -> None:
    def stacked(env: HighwayEnv) -> Any:
        frames = gymnasium.wrappers.FrameStackObservation(env, 3)
        return gymnasium.wrappers.FlattenObservation(frames)

    trained(stacked, tmp_path / "a.zip")
    refused(tmp_path / "a.zip", "these are 3 stacked observations")


def test_a_warning_is_one_line_of_the_command(here: Path) -> None:
    program = (
        "import warnings, sys\nfrom drl_av.cli.console import exit_status\n"
        "from drl_av.errors import DrlAvWarning\n"
        "sys.exit(exit_status('drl-av', lambda: warnings.warn('a\\x1bb.', DrlAvWarning) or 0))"
    )
    done = python("-c", program)
    assert (done.returncode, done.stderr) == (0, "drl-av: a\\x1bb.\n")
