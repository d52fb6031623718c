"""The check ``paper`` inside an exported file executes what the check itself does."""

from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest

from drl_av.cli import main
from drl_av.config import Config
from drl_av.drivers.learned import load_learned
from drl_av.drivers.onnx_graph import Graph, checked_by_paper
from drl_av.drivers.policy_file import SHIPPED
from drl_av.driving.actions import ACTIONS
from drl_av.driving.observation_scale import ObservationScale
from drl_av.driving.scene import LaneChange, Scene
from drl_av.errors import ConfigError
from drl_av.road.road import Road
from drl_av.safety.paper import Paper

ROAD = Road(500.0, 3.8, (True, True, True))


def random_scenes(count: int) -> list[Scene]:
    """Up to 12 vehicles on three lanes within 100 m, and the ego in a lane or in a lane change."""
    rng, found = np.random.default_rng(5), []
    for _ in range(count):
        others, lane, seconds = rng.integers(0, 13), int(rng.integers(3)), int(rng.integers(5))
        side = int(rng.choice([-1, 1])) if lane == 1 else 1 - lane
        change = LaneChange(lane, lane + side) if seconds else None
        y_m, v_y = 3.8 * lane + 0.76 * side * seconds, 0.76 * side * (seconds > 0)
        s_m = np.append(0.0, rng.uniform(-100, 100, others))
        y_m = np.append(y_m, 0.76 * rng.integers(0, 11, others))
        speed_m_s = rng.uniform(0, 30, others + 1).round(1)
        lateral_m_s = np.append(v_y, rng.choice([0.0, 0.76], others))
        found.append(Scene.from_arrays(s_m, y_m, speed_m_s, lateral_m_s, lane_change=change))
    return found


SCENES = random_scenes(10_000)
INDICATORS = np.array([scene.affordances.vector() for scene in SCENES])
CHANGING = np.array([scene.lane_change is not None for scene in SCENES])
PRINTED = {"printed_rule_1": True, "printed_rule_3": True}


@pytest.mark.parametrize("settings", [{}, PRINTED, {"minimum_gap_m": 2.5, "minimum_ttc_s": 1.0}])
def test_all_12_actions_are_replaced_as_by_the_check(settings: dict[str, float]) -> None:
    config, graph, helper = Config().updated("safety", **settings), Graph(), onnx.helper
    checked_by_paper(graph, "proposed", "indicators", "changing", config, 3.8)
    kinds = {"proposed": (7, ["n"]), "indicators": (11, ["n", 27]), "changing": (9, ["n"])}
    given = [helper.make_tensor_value_info(name, *kind) for name, kind in kinds.items()]
    out = [helper.make_tensor_value_info("action", 7, ["n"])]
    made = helper.make_graph(graph.nodes, "check", given, out, graph.constants)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    session = onnxruntime.InferenceSession(model.SerializeToString())
    check, replaced = Paper(config.safety), set()
    expected = np.array([check.verdicts(scene).executed for scene in SCENES])
    for number in range(12):
        proposed = np.full(len(SCENES), number)
        feed = {"proposed": proposed, "indicators": INDICATORS, "changing": CHANGING}
        [action] = session.run(None, feed)
        assert action.tolist() == expected[:, number].tolist()
        replaced |= {(number, int(other)) for other in action}
    assert len(replaced) > 40  # pairs of a proposed and an executed action


def test_the_file_decides_as_the_driver_under_the_check_on_10_000_observations(
    tmp_path: Path,
) -> None:
    file = tmp_path / "driver.onnx"
    assert main(["export", "pretrained", str(file), "--safety-check", "paper"]) == 0
    driver, config = load_learned(SHIPPED["pretrained"])
    check, changed = Paper(config.safety), 0
    scale = ObservationScale(config.observation, config.ego.max_speed_m_s, ROAD)
    session = onnxruntime.InferenceSession(file)
    actions, _ = session.run(None, {"indicators": INDICATORS, "lane_change": CHANGING})
    for scene, indicators, action in zip(SCENES, INDICATORS, actions, strict=True):
        proposed = driver.act(scene, scale(indicators))
        executed = check(scene, proposed).action
        assert ACTIONS[action] == executed
        changed += executed != proposed
    assert changed > 1000
    assert "passed the check paper" in onnx.load(file).graph.doc_string


@pytest.mark.parametrize(
    ("run", "check", "reason"),
    [
        ("pretrained", "strict", "a file can hold paper only: strict needs all vehicles around"),
        ("pretrained-large", "paper", "takes the permitted actions as an input"),
    ],
)
def test_a_check_that_the_file_cannot_hold_is_refused(
    run: str, check: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "driver.onnx"
    assert main(["export", run, str(file), "--safety-check", check]) == 1
    assert reason in capsys.readouterr().err
    assert not file.exists()


def test_a_plant_whose_lateral_speed_tells_no_direction_is_refused() -> None:
    config = Config().updated("ego", lateral_plant="steering")
    with pytest.raises(ConfigError, match="lateral_plant = 'kinematic'"):
        checked_by_paper(Graph(), "proposed", "indicators", "changing", config, 3.8)
