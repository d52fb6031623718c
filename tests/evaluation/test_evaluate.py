"""``drl_av.evaluate`` and ``drl_av.load_driver``: the command line's results in a program."""

import csv
import random
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
import pytest

import drl_av
from drl_av.cli import main
from drl_av.config import Config
from drl_av.drivers.checked import PolicyDriver
from drl_av.drivers.learned import mirrored_values, network_values
from drl_av.drivers.network import QNetwork
from drl_av.drivers.policy_file import save_policy
from drl_av.drivers.registry import default_config, find_drivers
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError, DrlAvError, RunError

SHORT: dict[str, Any] = {"simulation": {"decisions_per_episode": 6}}
SEED = 800_000


class Brakes:
    """A driver of the user's own."""

    def start(self, seed: int) -> None:
        """Stateless and deterministic."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Brake."""
        return ACTIONS[2]


def test_its_rows_are_those_of_the_command_line(tmp_path: Path) -> None:
    table = tmp_path / "rows.csv"
    words = ["evaluate", "pretrained", "idm", "--vehicles", "3", "8", "--episodes", "2"]
    words += ["--seed", str(SEED), "--safety-check", "strict", "--traffic", "overtaking"]
    words += ["-o", "simulation.decisions_per_episode=6", "--out", str(table)]
    assert main(words) == 0
    given: dict[str, Any] = {"vehicles": [3, 8], "episodes": 2, "seed": SEED, "config": SHORT}
    given |= {"safety_check": "strict", "traffic": "overtaking"}
    rows = drl_av.evaluate(["pretrained", "idm"], **given)
    written = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    begun = [(row.vehicles, row.seed, row.driver) for row in rows[:3]]
    assert begun == [(3, SEED, "pretrained"), (3, SEED, "idm"), (3, SEED + 1, "pretrained")]
    assert len(rows) == len(written) == 8
    for row, line in zip(rows, written, strict=True):
        found = {key: str(value) for key, value in asdict(row).items()}
        assert {key: found[key] for key in line} == line


def test_an_object_of_the_program_drives_beside_the_shipped_driver() -> None:
    settings = {"vehicles": 0, "episodes": 1, "seed": SEED, "config": SHORT}
    settings["safety_check"] = "paper"  # by default that of the shipped driver, where it drives
    [shipped] = drl_av.evaluate(**settings)
    [same, mine] = drl_av.evaluate("pretrained", own={"mine": Brakes()}, **settings)
    assert same == shipped
    assert (mine.driver, mine.decisions) == ("mine", 6)
    assert mine.mean_speed_m_s < shipped.mean_speed_m_s
    assert drl_av.evaluate(own={"mine": Brakes()}, **settings) == [mine]


@pytest.mark.parametrize(
    "config", [None, {"traffic": {"vehicles_max": 5}}, Config(), "paper"], ids=str
)
def test_a_trained_driver_keeps_the_mirror_of_its_training(config: Any, tmp_path: Path) -> None:
    file = tmp_path / "policy.safetensors"
    network = QNetwork(np.random.default_rng(0))
    save_policy(file, network, Config().updated("learning", mirrored=True))
    driver: Any = drl_av.load_driver(file, config)
    s = np.linspace(-1, 1, 27, dtype=np.float32)
    assert np.array_equal(driver.values(s), mirrored_values(network_values(network))(s))


def test_a_loaded_driver_drives_the_environment_as_its_evaluation_does() -> None:
    config = default_config(find_drivers(["pretrained"]))
    config = config.updated("simulation", decisions_per_episode=6)
    driver, speeds = drl_av.load_driver("pretrained"), []
    with gymnasium.make("drl_av/Highway-v0", config=config) as env:
        observation, _ = env.reset(seed=SEED, options={"vehicles": 8})
        driver.start(SEED)
        for _ in range(6):
            action = driver.act(env.unwrapped.scene, observation)  # type: ignore[attr-defined]
            observation, *_, info = env.step(action.number)  # type: ignore[arg-type]
            speeds.append(info["speed_m_s"])
    [row] = drl_av.evaluate(vehicles=8, episodes=1, seed=SEED, config=SHORT)
    assert row.mean_speed_m_s == sum(speeds) / 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"episodes": 0}, "episodes is 0, but must be a whole number from 1 on"),
        ({"vehicles": [3, 2.5]}, "vehicles is 2.5, but must be a whole number from 0 on"),
        ({"vehicles": True}, "vehicles is True"),
        ({"seed": -1}, "seed is -1"),
        ({"jobs": "two"}, "jobs is 'two'"),
        ({"drivers": "pretraind"}, "did you mean 'pretrained'"),
        ({"own": {"mine": 3}}, "'mine' in own is a int, but must be an object with start"),
        ({"own": {"mine": Brakes}}, "'mine' in own is a type, .* a class .* has to be called"),
        ({"own": {3: Brakes()}}, "own names a driver 3, but a name must be a text"),
        ({"own": [Brakes()]}, r"own is a list, .* write own=\{'mine': driver\}"),
        ({"drivers": [Brakes()]}, r"has a Brakes, .* pass a driver object as own=\{'mine': driver"),
        ({"drivers": lambda config: Brakes()}, "has a function, .* or 'module:function'"),
        ({"drivers": None}, "has a NoneType, but must have names and paths"),
        ({"drivers": "nowhere/agent.zip"}, r"There is no file nowhere/agent\.zip"),
        ({"vehicles": [None]}, "vehicles is None, but must be a whole number"),
        ({"vehicles": []}, "vehicles names no number of vehicles: name one, or leave it out"),
        ({"drivers": "idm", "own": {"idm@strict": Brakes()}}, "'idm@strict', as one of ours"),
        ({"traffic": "calmm"}, "did you mean 'calm'"),
        ({"safety_check": "strickt"}, "did you mean 'strict'"),
        ({"config": {"trafic": {}}}, "did you mean 'traffic'"),
        ({"config": {"ppo": {"discount": 0.9}}}, "ppo.discount is a setting of trainings, which e"),
        ({"config": {"traffic": {"vehicles_max": 9}}}, r"numbers here with vehicles=\[5, 10\]"),
        ({"scenario": "nowhere"}, "There is no scenario 'nowhere'"),
    ],
)
def test_a_wrong_argument_is_refused_in_one_sentence(
    arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(DrlAvError, match=message) as caught:
        drl_av.evaluate(**({"vehicles": 1, "episodes": 2} | arguments))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("driver", [None, 3, Brakes(), lambda config: Brakes()])
def test_a_driver_is_loaded_by_its_name_or_path_only(driver: Any) -> None:
    with pytest.raises(ConfigError, match=r"must be a name, a path or 'module:function'"):
        drl_av.load_driver(driver)


def test_numbers_of_numpy_are_taken_as_those_of_python() -> None:
    settings: dict[str, Any] = {"config": {"simulation": {"decisions_per_episode": np.int64(3)}}}
    found = drl_av.evaluate(
        "idm", vehicles=np.array([2, 4]), episodes=np.int32(1), seed=np.uint8(7), **settings
    )
    assert [(row.vehicles, row.seed, row.decisions) for row in found] == [(2, 7, 3), (4, 7, 3)]


def test_a_driver_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no driver or run folder 'runs/none'"):
        drl_av.load_driver("runs/none")
    with pytest.raises(RunError, match="holds no trained driver"):
        drl_av.load_driver(tmp_path)
    with pytest.raises(AttributeError, match="no attribute 'evaluat'"):
        drl_av.evaluat  # noqa: B018


def test_a_policy_of_an_open_road_drives_with_the_observation_of_its_environment() -> None:
    with closing(gymnasium.make("drl_av/Exit-v0")) as env:
        observe, space = env.unwrapped.observe, env.observation_space
    seen = []

    def policy(observation: np.ndarray) -> int:
        seen.append(observation)
        return 0

    short = {"simulation": {"decisions_per_episode": 3}}
    own = {"mine": PolicyDriver(policy, observe)}
    [row] = drl_av.evaluate(own=own, scenario="exit", episodes=1, vehicles=5, config=short)
    assert (row.driver, row.decisions, len(seen)) == ("mine", 3, 3)
    assert space.shape == (30,)
    assert all(observation in space for observation in seen)
    # the ego starts on the leftmost of three lanes: three changes to the right, of three possible
    assert seen[0][observe.names.index("way_changes")] == -1


def test_results_are_a_data_frame_and_a_table_in_a_notebook() -> None:
    rows = drl_av.evaluate(["idm", "gap-mobil"], vehicles=[1, 2], episodes=2, config=SHORT)
    frame = rows.to_pandas()
    assert frame.shape == (8, 20)
    assert frame.groupby("driver").mean_speed_m_s.mean()["idm"] == pytest.approx(
        sum(row.mean_speed_m_s for row in rows if row.driver == "idm") / 4
    )
    assert [*frame.columns[:3]] == ["driver", "safety_check", "vehicles"]
    assert (rows[:3] + rows[3:]).to_pandas().equals(frame)
    assert rows[-1].driver == "gap-mobil"
    shown = rows._repr_html_()
    assert shown.count("<tr>") == 5
    assert "<td>idm</td><td>paper</td><td>2</td>" in shown
    named = drl_av.evaluate([], own={"<b>": Brakes()}, vehicles=1, episodes=1, config=SHORT)
    assert "&lt;b&gt;" in named._repr_html_()


def test_a_data_frame_says_of_each_row_in_which_world_it_was_driven() -> None:
    rows = drl_av.evaluate("idm", vehicles=1, episodes=1, config=SHORT)
    twin = {"simulation": {**SHORT["simulation"], "world": "twin"}}
    rows += drl_av.evaluate("idm", vehicles=1, episodes=1, config=twin)
    frame = rows.to_pandas()
    assert frame.groupby("world").size().to_dict() == {"sumo": 1, "twin": 1}
    assert "<p>idm drove seed 0 among 1 vehicle twice" in (rows + rows)._repr_html_()


def test_the_package_shows_its_public_names_and_nothing_else() -> None:
    assert dir(drl_av) == sorted([*drl_av.__all__, "__version__"])
    assert all(callable(getattr(drl_av, name)) for name in drl_av.__all__)


def test_a_driver_is_trained_by_a_program_and_evaluated(tmp_path: Path) -> None:
    drawn: list[float] = []

    def price(transition: Any) -> float:
        drawn.append(random.random())
        return -0.25

    config = {**SHORT, "learning": {"hidden_units": 4, "evaluation_episodes": 1}}
    run = drl_av.train(
        tmp_path / "run", config=config, episodes=2, seed=5, reward=price, safety_check="strict"
    )
    assert random.random() not in drawn  # the reward's own random numbers go on
    rows = list(csv.DictReader((run / "episodes.csv").read_text().splitlines()))
    assert [row["mean_reward"] for row in rows] == ["-0.25", "-0.25"]
    [row] = drl_av.evaluate(run, vehicles=1, episodes=1)
    assert (row.driver, row.safety_check) == ("run", "strict")
    with pytest.raises(RunError, match="exists already"):
        drl_av.train(run)
