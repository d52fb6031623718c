"""The exported driver decides as the driver does, in a program that knows only ONNX."""

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from runs import Capsys
from worlds import ALONE, ROAD

from drl_av.cli import main
from drl_av.config import Config, from_toml
from drl_av.config.reference import annotated_toml
from drl_av.drivers.network import QNetwork
from drl_av.drivers.onnx import described, export
from drl_av.drivers.policy_file import SHIPPED, load_run, save_policy
from drl_av.drivers.registry import default_config, find_drivers, load_learned, make_drivers
from drl_av.driving.actions import ACTIONS
from drl_av.driving.affordances import INDICATORS, SLOTS
from drl_av.driving.observation_scale import ObservationScale
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.errors import ConfigError, DrlAvError, RunError
from drl_av.scenarios.folder import ScenarioDescription, write_scenario


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose driver learned in a mirror, with settings of its own."""
    folder = tmp_path_factory.mktemp("run")
    config = Config().with_traffic("calm").updated("traffic", vehicles_max=7)
    config = config.updated("safety", check="strict").updated("learning", mirrored=True)
    save_policy(folder / "policy.safetensors", QNetwork(np.random.default_rng(0)), config)
    (folder / "config.toml").write_text(annotated_toml(config))
    return folder


@pytest.fixture(scope="module")
def exported(run: Path) -> Path:
    assert main(["export", str(run), str(run / "driver.onnx")]) == 0
    return run / "driver.onnx"


def test_it_decides_as_the_driver_on_10_000_observations(exported: Path, run: Path) -> None:
    driver, config = load_learned(run)
    scale = ObservationScale(config.observation, config.ego.max_speed_m_s, ROAD)
    rng = np.random.default_rng(0)
    s = rng.uniform(-1.2, 1.2, (10_000, len(INDICATORS))) * scale.bounds  # some are clipped
    indicators = s * scale.scale + scale.offset
    session = onnxruntime.InferenceSession(exported, providers=["CPUExecutionProvider"])
    actions, q = session.run(None, {"indicators": indicators})
    for row in range(10_000):
        observation = scale(indicators[row])
        assert q[row] == pytest.approx(driver.values(observation), abs=1e-4)
        assert ACTIONS[actions[row]] == driver.act(ALONE, observation), row


def test_the_file_describes_its_inputs_outputs_indicators_and_actions(exported: Path) -> None:
    graph = onnx.load(exported).graph
    kinds = onnx.TensorProto
    shown = {
        port.name: (
            port.type.tensor_type.elem_type,
            [axis.dim_param or axis.dim_value for axis in port.type.tensor_type.shape.dim],
        )
        for port in (*graph.input, *graph.output)
    }
    assert shown == {
        "indicators": (kinds.DOUBLE, ["rows", 27]),
        "action": (kinds.INT64, ["rows"]),
        "q": (kinds.FLOAT, ["rows", 12]),
    }
    meanings = {port.name: port.doc_string for port in (*graph.input, *graph.output)}
    assert "in SI units, unscaled" in meanings["indicators"]
    assert "no safety check" in graph.doc_string
    session = onnxruntime.InferenceSession(exported, providers=["CPUExecutionProvider"])
    held = session.get_modelmeta().custom_metadata_map
    indicators, actions = json.loads(held["indicators"]), json.loads(held["actions"])
    assert [each["name"] for each in indicators] == list(INDICATORS)
    assert indicators[4] == {"name": "own_rear_d_x", "meaning": "net gap, bumper to bumper, m"}
    assert indicators[24] == {"name": "ego_v_x", "meaning": "speed of the ego, m/s"}
    assert (actions[0], actions[5], actions[11]) == tuple(str(ACTIONS[n]) for n in (0, 5, 11))
    config = load_learned(exported.parent)[1]
    assert from_toml(held["config"]) == config
    assert default_config(find_drivers([exported])) == config  # it drives with these settings


def test_the_help_of_export_describes_them_too(capsys: Capsys) -> None:
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    shown = " ".join(capsys.readouterr().out.split())
    assert described() in shown
    order = [shown.index(f" {slot}") for slot in SLOTS]
    assert order == sorted(order)
    assert "Output q, float32 (rows, 12): Q-values" in shown


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("dqn.zip", "dqn.zip is an agent of stable-baselines3, not a driver that drl-av trained: "),
        ("net.onnx", "net.onnx is an ONNX network, not a driver that drl-av trained: give a run's"),
        ("drive.npz", "drive.npz is a recorded episode, not a driver that drl-av trained: give a"),
        ("fast.toml", "fast.toml is a file of settings, not a driver that drl-av trained: give a"),
        ("nope", "There is no file or folder nope: give a run's folder that has a policy.safetens"),
        ("empty", "empty holds no trained driver: give a run's folder that has a policy.safetens"),
        ("idm", "idm is not a driver that drl-av trained, and has no network to export: give a"),
        ("planner", "planner is not a driver that drl-av trained, and has no network to export: "),
        ("module:factory", "module:factory is not a driver that drl-av trained, and has no"),
    ],
)
def test_what_cannot_be_exported_is_named_with_what_can(
    word: str, message: str, here: Path, capsys: Capsys
) -> None:
    for file in ("dqn.zip", "net.onnx", "drive.npz", "fast.toml"):
        Path(file).write_bytes(b"PK")
    Path("empty").mkdir()
    assert main(["export", word, "out.onnx"]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"drl-av: {message}")
    assert "pretrained" in said
    assert "leave the run out" not in said
    assert not Path("out.onnx").exists()


def test_a_driver_whose_inputs_the_file_lacks_is_not_exported(tmp_path: Path) -> None:
    network, config = load_run(SHIPPED["pretrained-paper"])
    config = config.updated("observation", way=True)
    scale = ObservationScale(config.observation, config.ego.max_speed_m_s, ROAD)
    with pytest.raises(DrlAvError, match=r"way cannot .* no inputs for its way: train one without"):
        export(tmp_path / "driver.onnx", network, config, scale)
    assert not any(tmp_path.iterdir())


def test_the_exported_driver_drives_the_same_episode(exported: Path) -> None:
    specs = find_drivers([str(exported.parent)])
    _, config = load_learned(exported.parent)
    config = config.updated("simulation", decisions_per_episode=40)
    [own] = make_drivers(specs, config).values()
    [other] = make_drivers(find_drivers([str(exported)]), config).values()
    with closing(HighwayEnv(config=config)) as env:
        first = drive(env, own, "driver", 800_000, 15)
        assert drive(env, other, "driver", 800_000, 15) == first


def test_the_exported_driver_is_refused_where_its_run_is_and_on_other_lanes(
    exported: Path, tmp_path: Path
) -> None:
    config, specs = Config().updated("learning", mirrored=True), find_drivers([str(exported)])
    with pytest.raises(RunError, match="settings or another"):
        make_drivers(specs, config.updated("ego", max_speed_m_s=40.0))
    write_scenario(tmp_path / "five", ScenarioDescription(lanes=5))
    five = config.updated("simulation", scenario=str(tmp_path / "five"))
    with pytest.raises(ConfigError, match="scales the lateral position by the lanes of its train"):
        make_drivers(specs, five)
    make_drivers(find_drivers([str(exported.parent)]), five)
