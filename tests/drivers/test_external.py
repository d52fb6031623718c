"""Drivers of the user's own, by a factory, a stable-baselines3 zip or an ONNX file."""

import csv
import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from programs import python
from runs import Capsys
from stable_baselines3 import DQN, PPO
from worlds import ALONE

from drl_av.cli import main
from drl_av.config import Config
from drl_av.config.functions import is_factory, source_digest
from drl_av.drivers.agent import driver_of_agent
from drl_av.drivers.external import driver_of_factory, files_of
from drl_av.drivers.onnx import OnnxDriver
from drl_av.drivers.policy_file import PRETRAINED
from drl_av.drivers.registry import find_drivers, make_drivers
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.errors import CheckpointError, ConfigError
from drl_av.safety.check import Rule, Verdict, permit_all

OWN = """
from drl_av.driving.actions import ACTIONS

class Careful:
    def __init__(self, brakes):
        self.brakes = brakes
    def start(self, seed):
        pass
    def act(self, scene, observation):
        return ACTIONS[2 if self.brakes else 0]

def careful(config):
    return Careful(config.traffic.vehicles_max == 7)

def nothing(config):
    return 3

def eager():
    return Careful(False)

number = 3
"""
OBSERVATION = np.zeros(27, np.float32)


@pytest.fixture
def module(here: Path) -> str:
    (here / "my_own_drivers.py").write_text(OWN)
    (here / "broken_module.py").write_text("def f(config:\n")
    (here / "failing_module.py").write_text("1 / 0\n")
    return "my_own_drivers"


def test_a_factory_makes_a_driver_for_the_config(module: str) -> None:
    config = Config().updated("traffic", vehicles_max=7)
    assert driver_of_factory(f"{module}:careful", config).act(ALONE, OBSERVATION).number == 2
    assert driver_of_factory(f"{module}:careful", Config()).act(ALONE, OBSERVATION).number == 0


def test_it_stands_in_the_table_beside_the_others_in_several_processes(module: str) -> None:
    words = ["evaluate", "idm", "--driver", f"{module}:careful", "--vehicles", "3"]
    words += ["--episodes", "1", "--jobs", "2", "--out", "rows.csv"]
    assert main(words) == 0
    rows = list(csv.DictReader(Path("rows.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["driver"] for row in rows] == ["idm", f"{module}:careful"]


def test_replay_takes_each_form_of_driver_that_its_help_names(module: str, capsys: Capsys) -> None:
    with HighwayEnv() as env:
        DQN("MlpPolicy", env, buffer_size=10, device="cpu").save("agent.zip")
    network(Path("own.onnx"), 27)
    shutil.copy(PRETRAINED / "policy.safetensors", "policy.safetensors")
    words = (str(PRETRAINED), "policy.safetensors", "agent.zip", "own.onnx", f"{module}:careful")
    for word in (*words, "idm", "pretrained"):
        assert main(["replay", word, "--html", "page.html", "--decisions", "2"]) == 0
        assert "2 decisions" in capsys.readouterr().out
    for verb in ("replay", "evaluate"):
        with pytest.raises(SystemExit):
            main([verb, "--help"])
        shown = " ".join(capsys.readouterr().out.split())
        forms = ("folder of a run", ".safetensors", ".zip", ".onnx", "module:factory", "pretrained")
        assert all(form in shown for form in forms)


@pytest.mark.skipif(os.name == "nt", reason="named pipes")
@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo], ids=["folder", "pipe"])
@pytest.mark.parametrize("name", ["own.zip", "own.onnx"])
def test_a_folder_or_pipe_in_place_of_a_file_is_one_sentence_and_not_waited_for(
    name: str, make: Callable[[Path], None], tmp_path: Path
) -> None:
    make(tmp_path / name)
    with pytest.raises(ConfigError, match=rf"{name} is no regular file: name a file, or rename"):
        find_drivers([str(tmp_path / name)])


@pytest.mark.parametrize("name", ["absent.zip", "absent.onnx", "absent.safetensors", "absent.npz"])
@pytest.mark.parametrize("words", [["evaluate", "--driver"], ["replay"], ["evaluate"]])
def test_a_file_that_is_not_there_is_said_to_be_missing(
    name: str, words: list[str], capsys: Capsys
) -> None:
    assert main([*words, f"nowhere/{name}"]) == 1
    found = capsys.readouterr().err
    assert found == f"drl-av: There is no file nowhere/{name}: correct its path.\n"


@pytest.mark.parametrize("verb", ["evaluate", "replay"])
def test_a_file_that_is_no_driver_is_refused_with_what_it_is(
    verb: str, here: Path, capsys: Capsys
) -> None:
    Path("mine.toml").write_text("[traffic]\nvehicles_max = 5\n", encoding="utf-8")
    short = [] if verb == "evaluate" else ["--video", "drive.gif", "--decisions", "3"]
    assert main([verb, "mine.toml", *short]) == 1
    found = capsys.readouterr().err
    assert found.startswith("drl-av: mine.toml is a file of settings, not a driver that drl-av tra")
    assert found.endswith("pass it as config, or after --config.\n")
    Path("notes.txt").write_text("a note", encoding="utf-8")
    assert main([verb, "notes.txt", *short]) == 1  # decoy: no recording whose --decisions is fixed
    found = capsys.readouterr().err
    what = "no recording" if verb == "replay" else "is no driver: name a run's folder, or a file"
    assert found.startswith("drl-av: notes.txt ")
    assert what in found
    assert found.count("\n") == 1


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("no_such_module:f", "No module named 'no_such_module'"),
        ("my_own_drivers:missing", "has no attribute 'missing'"),
        ("my_own_drivers:eager", r"is called with \(config\), which eager\(\) does not take"),
        ("my_own_drivers:number", r"my_own_drivers:number' is 3, but must be a function of \(conf"),
        ("broken_module:f", "cannot be imported"),
        ("failing_module:f", r"\(division by zero, line 1 of .*failing_module\.py\)"),
        ("my_own_drivers:nothing", "nothing' is a int, but must be an object with start"),
    ],
)
def test_a_factory_that_makes_no_driver_is_refused(word: str, message: str, module: str) -> None:
    with pytest.raises(ConfigError, match=message):
        driver_of_factory(word, Config())


def test_all_files_of_a_package_count_and_of_a_module_its_own(here: Path) -> None:
    (here / "pk").mkdir()
    files = here / "pk" / "__init__.py", here / "pk" / "impl.py", here / "alone.py"
    for file in files:
        file.write_text("LIMIT_S = 0.0\n")
    before = source_digest("pk:mine"), source_digest("alone:mine")
    assert before[1] == hashlib.sha256(b"LIMIT_S = 0.0\n").hexdigest()
    files[1].write_text("LIMIT_S = 5.0\n")
    assert source_digest("pk:mine") != before[0]
    assert source_digest("pk.impl:mine") == source_digest("pk:mine")
    assert source_digest("alone:mine") == before[1]
    assert source_digest("no_such_module:mine") == ""


def test_a_path_with_a_colon_is_no_factory() -> None:
    assert is_factory("a.b_1:c")
    assert not any(map(is_factory, ("C:/runs", "a:b:c", "a.b", ":c", "a:", "runs/a:b")))


def test_a_masked_agent_chooses_what_the_check_permits(tmp_path: Path) -> None:
    from sb3_contrib import MaskablePPO

    def only(scene: Scene, proposed: Action) -> Verdict:
        return Verdict(ACTIONS[7], Rule.NONE if proposed.number == 7 else Rule.IN_LANE)

    with HighwayEnv() as env:
        model = MaskablePPO("MlpPolicy", env, device="cpu")
        model.save(tmp_path / "agent.ZIP")
    [free, bound] = (
        driver_of_agent(tmp_path / "agent.ZIP", Config(), None, lambda check=check: check)
        for check in (permit_all, only)
    )
    assert {bound.act(ALONE, OBSERVATION).number for _ in range(3)} == {7}
    assert free.act(ALONE, OBSERVATION).number == model.predict(OBSERVATION, deterministic=True)[0]
    (tmp_path / "vecnormalize.pkl").touch()
    assert len(files_of(tmp_path / "agent.ZIP")) == 2


def test_an_agent_that_observes_its_way_drives_where_the_way_is_observed(tmp_path: Path) -> None:
    way = Config().updated("observation", way=True)
    with HighwayEnv("exit", config=way) as env:
        PPO("MlpPolicy", env, device="cpu").save(tmp_path / "agent.zip")
    specs = find_drivers([str(tmp_path / "agent.zip")])
    assert make_drivers(specs, way.updated("simulation", scenario="exit"))
    with pytest.raises(CheckpointError, match=r"\(30,\) and 12 actions, but drives with \(27,\)"):
        make_drivers(specs, Config())


def test_an_agent_of_another_environment_and_a_file_that_is_none_are_refused(
    tmp_path: Path,
) -> None:
    PPO("MlpPolicy", "CartPole-v1", device="cpu").save(tmp_path / "cart.zip")
    others = r"shape \(4,\) and 2 actions, but drives with \(27,\)"
    with pytest.raises(CheckpointError, match=others):
        driver_of_agent(tmp_path / "cart.zip", Config(), None, lambda: permit_all)
    (tmp_path / "none.zip").write_bytes(b"PK no zip")
    with pytest.raises(CheckpointError, match="no agent that stable-baselines3 saved"):
        driver_of_agent(tmp_path / "none.zip", Config(), None, lambda: permit_all)


FLOAT = TensorProto.FLOAT
OBSERVATIONS = helper.make_tensor_value_info("s", FLOAT, ["rows", 27])
VALUES = helper.make_tensor_value_info("q", FLOAT, ["rows", 12])


def save(
    path: Path,
    node: onnx.NodeProto,
    constants: dict[str, np.ndarray],
    given: onnx.ValueInfoProto = OBSERVATIONS,
    values: onnx.ValueInfoProto = VALUES,
    **external: Any,
) -> Path:
    """Save an ONNX network of one node."""
    tensors = [onnx.numpy_helper.from_array(array, name) for name, array in constants.items()]
    graph = helper.make_graph([node], "g", [given], [values], tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, str(path), **external)
    return path


def network(
    path: Path, inputs: int, outputs: int = 12, rows: int | str = "rows", kind: int = FLOAT
) -> Path:
    """An ONNX network whose values are the first ones of its inputs."""
    node = helper.make_node("Gather", ["s", "places"], ["q"], axis=1)
    shapes = {"s": [rows, inputs], "q": [rows, outputs]}
    ports = (helper.make_tensor_value_info(name, kind, shape) for name, shape in shapes.items())
    return save(path, node, {"places": np.arange(outputs)}, *ports)


def test_a_network_of_the_users_own_chooses_the_greatest_value(tmp_path: Path) -> None:
    driver = OnnxDriver(network(tmp_path / "own.onnx", 27))
    observation = OBSERVATION.copy()
    observation[[7, 20]] = 1.0, 2.0
    assert driver.act(ALONE, observation).number == 7


def test_networks_of_other_inputs_and_damaged_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"does not decide \(.*Got: 27 Expected: 20 Please"):
        OnnxDriver(network(tmp_path / "small.onnx", 20))
    (tmp_path / "cut.onnx").write_bytes((tmp_path / "small.onnx").read_bytes()[:40])
    with pytest.raises(CheckpointError, match="cannot be read as an ONNX network"):
        OnnxDriver(tmp_path / "cut.onnx")


def test_a_network_with_a_wrong_number_of_values_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"returns \[0.*\): export .* 12 values"):
        OnnxDriver(network(tmp_path / "four.onnx", 27, 4))
    driver = OnnxDriver(network(tmp_path / "own.onnx", 27))
    with pytest.raises(ConfigError, match=r"own\.onnx returns \[nan, .* none of them nan"):
        driver.act(ALONE, np.full(27, np.nan, np.float32))
    masked = np.full(27, -np.inf, np.float32)
    masked[3] = 1.0
    assert driver.act(ALONE, masked).number == 3


@pytest.mark.parametrize(("rows", "kind"), [(8, TensorProto.FLOAT), ("rows", TensorProto.DOUBLE)])
def test_a_network_that_cannot_run_on_one_observation_is_refused_when_it_is_read(
    tmp_path: Path, rows: int | str, kind: int
) -> None:
    path = network(tmp_path / "own.onnx", 27, rows=rows, kind=kind)
    with pytest.raises(CheckpointError, match=r"does not decide .* float32 of shape \(rows, 27\)"):
        OnnxDriver(path)


def test_weights_in_another_file_are_those_beside_the_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = helper.make_node("Gemm", ["s", "zeros", "bias"], ["q"])
    beside = {"save_as_external_data": True, "location": "weights", "size_threshold": 0}
    for folder, best in (("model", 4), ("elsewhere", 9)):
        (tmp_path / folder).mkdir()
        weights = {"bias": np.eye(12, dtype=np.float32)[best], "zeros": np.zeros((27, 12), "f4")}
        save(tmp_path / folder / "own.onnx", node, weights, **beside)
    monkeypatch.chdir(tmp_path / "elsewhere")
    driver = OnnxDriver(Path("../model/own.onnx"))
    assert driver.act(ALONE, OBSERVATION).number == 4


def endless(path: Path) -> Path:
    """A network that adds 1 without an end."""
    kinds = {"i": (TensorProto.INT64, []), "go": (TensorProto.BOOL, []), "x": (FLOAT, ["rows", 27])}
    kinds |= {"go_on": kinds["go"], "y": kinds["x"]}
    *some, go_on, y = (helper.make_tensor_value_info(name, *kind) for name, kind in kinds.items())
    nodes = [
        helper.make_node("Identity", ["go"], ["go_on"]),
        helper.make_node("Tanh", ["x"], ["y"]),
    ]
    body = helper.make_graph(nodes, "body", some, [go_on, y])
    node = helper.make_node("Loop", ["most", "true", "s"], ["q"], body=body)
    return save(path, node, {"true": np.array(True), "most": np.array(2**62)})


def test_a_network_without_an_end_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drl_av.drivers.onnx.LONGEST_RUN_S", 0.5)
    with pytest.raises(CheckpointError, match=r"has not decided within 0\.5 s: export"):
        OnnxDriver(endless(tmp_path / "own.onnx"))


def test_a_network_without_an_end_can_be_interrupted(tmp_path: Path) -> None:
    path = endless(tmp_path / "own.onnx")
    program = (
        "import os, signal, sys, threading\nfrom drl_av.cli import main\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may ignore it\n"
        "import drl_av.drivers.onnx as module\nmodule.LONGEST_RUN_S = 1000.0\n"
        "wait = module.OnnxDriver._run\n"
        "def watched(self, row):\n"
        "    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "    return wait(self, row)\n"
        "module.OnnxDriver._run = watched\n"
        f"sys.exit(main(['evaluate', {str(path)!r}, '--vehicles', '1', '--episodes', '1']))"
    )
    done = python("-c", program)
    assert done.returncode == 130
    assert done.stderr == "drl-av: interrupted.\n"


def test_a_network_of_text_is_one_sentence(tmp_path: Path) -> None:
    node = helper.make_node("Identity", ["text"], ["q"])
    made = helper.make_tensor_value_info("q", TensorProto.STRING, ["rows", 12])
    text = {"text": np.array([["a"] * 12], dtype=object)}
    path = save(tmp_path / "text.onnx", node, text, values=made)
    with pytest.raises(CheckpointError, match="does not decide"):
        OnnxDriver(path)
