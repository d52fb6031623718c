"""Settings as a program may give them, all checked alike."""

import tomllib
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import drl_av
from drl_av.config import Config, with_files
from drl_av.config.presets import as_config, preset
from drl_av.errors import ConfigError

FIVE = Config().updated("traffic", vehicles_max=5)
WRONG = [
    ("[trafic]\n", r"no section \[trafic\] \(did you mean 'traffic'\?\)"),
    ("[5]\n", r"no section \[5\]"),
    ("traffic = 5\n", "traffic must be a section"),
    ("[traffic]\nvehicle_max = 5\n", r"no key 'vehicle_max' \(did you mean 'vehicles_max'\?\)"),
    (
        "[traffic]\nvehicles_max = 5.0\n",
        "traffic.vehicles_max is 5.0, but must be a whole number from",
    ),
    ("[traffic]\nvehicles_max = -1\n", "traffic.vehicles_max is -1, but must be"),
    ("[learning]\nseed = -1\n", "must be a whole number from 0 to 4294967295.$"),
]


def test_all_ways_to_give_settings_make_the_same_environment(tmp_path: Path) -> None:
    file = tmp_path / "five.toml"
    file.write_text("[traffic]\nvehicles_max = 5\n")
    for given in (FIVE, {"traffic": {"vehicles_max": 5}}, file, str(file)):
        with closing(gymnasium.make("drl_av/Highway-v0", config=given)) as env:
            assert env.get_wrapper_attr("config") == FIVE
            assert env.reset(seed=3)[1]["vehicles"] <= 5
    assert drl_av.__version__


def test_a_preset_has_its_name_and_nothing_stands_for_the_paper_s(here: Path) -> None:
    assert as_config("large") == preset("large") != Config()
    assert as_config("paper") == as_config(None) == as_config({}) == Config()
    Path("large").write_text("[traffic]\nvehicles_max = 5\n")
    assert as_config("large") == preset("large")
    assert as_config("./large") == as_config(Path("large")) == FIVE


@pytest.mark.parametrize(
    "words", ["paper-exit", "paper-ramp_to_ramp", "large-merge", "large-exit", "large-ramp_to_ramp"]
)
def test_a_preset_for_ramps_observes_the_way_under_strict(words: str) -> None:
    name, scenario = words.split("-")
    found, plain = preset(words), preset(name)
    assert found.simulation.scenario == scenario
    assert (found.observation.way, plain.observation.way) == (True, False)
    assert found.safety.check == "strict"
    assert found.learning.discount == plain.learning.discount
    assert found.simulation.world == plain.simulation.world


def test_numbers_of_numpy_and_paths_become_what_a_file_would_hold() -> None:
    sections = {
        "traffic": {"vehicles_max": np.int64(5), "vehicles_min": np.array(2)},
        "ego": {"max_speed_m_s": np.float64(25.5)},
        "reward": {"desired_speed_m_s": np.int32(28)},
        "simulation": {"scenario": Path("my_loop")},
    }
    wanted = FIVE.updated("traffic", vehicles_min=2).updated("ego", max_speed_m_s=25.5)
    wanted = wanted.updated("reward", desired_speed_m_s=28.0)
    wanted = wanted.updated("simulation", scenario="my_loop")
    assert as_config(sections) == wanted
    assert as_config(sections).to_toml() == wanted.to_toml()


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("vehicles_max", np.float64(5.0), r"vehicles_max is 5.0, but must be a whole number from"),
        ("vehicles_max", np.array([5]), r"vehicles_max is array\(\[5\]\), but must be a whole"),
        ("vehicles_max", np.bool_(True), "vehicles_max is True, but must be a whole number from"),
        ("headway_min_s", np.float64("nan"), "headway_min_s is nan, but must be a number from"),
        ("kind", ["calm"], r"no kind of traffic \['calm'\]"),
    ],
)
def test_numbers_of_numpy_are_checked_as_those_of_python(
    key: str, value: Any, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        as_config({"traffic": {key: value}})


@pytest.mark.parametrize(("text", "message"), WRONG)
def test_sections_are_refused_as_a_file_of_them_is(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(text)
    for given in (tomllib.loads(text), file):
        with pytest.raises(ConfigError, match=message):
            as_config(given)


def test_a_section_that_is_named_by_a_number_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"no section \[5\]"):
        as_config({5: {}})


@pytest.mark.parametrize("given", ["largge", "/nowhere/fast.toml", "", 5, ["traffic"]])
def test_what_is_no_config_is_refused_with_all_that_would_be(given: Any) -> None:
    all_that_would_be = r"must be a preset \(paper, large, .*\), a TOML"
    with pytest.raises(ConfigError, match=all_that_would_be) as caught:
        as_config(given)
    assert repr(given) in str(caught.value)
    assert ("did you mean 'large'" in str(caught.value)) == (given == "largge")


def test_traffic_beside_a_preset_or_a_config_replaces_its_traffic() -> None:
    calm = Config().with_traffic("calm").traffic
    for given in ("literal", preset("literal"), {}, None):
        assert as_config(given, traffic="calm").traffic == calm
    assert as_config("literal", traffic="calm").reward == preset("literal").reward
    assert as_config("large", traffic="calm").traffic.presets == ()
    changed = as_config({"traffic": {"hard_braking_share": 0.5}}, traffic="calm")
    assert changed.traffic.hard_braking_share == 0.5
    with pytest.raises(ConfigError, match="traffic is calm, but the settings beside it"):
        as_config({"traffic": {"presets": ("paper",)}}, traffic="calm")


@pytest.mark.parametrize("order", [1, -1])
def test_settings_that_fit_together_are_taken_in_any_order(order: int, tmp_path: Path) -> None:
    pair = ["traffic.vehicles_min=40", "traffic.vehicles_max=50"][::order]
    files = []
    for number, word in enumerate(pair):
        file = tmp_path / f"{number}.toml"
        section, rest = word.split(".")
        file.write_text(f"[{section}]\n{rest}\n")
        files.append(file)
    for given in (pair, files):
        found = with_files(Config(), given).traffic
        assert (found.vehicles_min, found.vehicles_max) == (40, 50)
    with pytest.raises(ConfigError, match=r"In traffic.vehicles_min=40: .*they are 40, 30"):
        with_files(Config(), ["traffic.vehicles_min=40", "safety.check=strict"])
    with pytest.raises(ConfigError, match=r"no key 'vehicle_max' \(did you mean 'vehicles_max'"):
        with_files(Config(), ["traffic.vehicles_min=40", "traffic.vehicle_max=50"])
    files[0].write_text("[learning]\nsed = 3\n")
    files[1].write_text("[learning]\nseed = 4\n")
    with pytest.raises(ConfigError, match=r"0.toml: \[learning\] has no key 'sed'"):
        with_files(Config(), files)
    with pytest.raises(ConfigError, match=r"traffic.vehicles_max=5\nvehicles_min=3: .*must be"):
        with_files(Config(), ["traffic.vehicles_max=5\nvehicles_min=3"])
    with pytest.raises(ConfigError, match=r"vehicles_max is .xxx"):
        with_files(Config(), [f"traffic.vehicles_max={300 * 'x'}"])
    late = ["traffic.truck_share=0.2", "traffic.kind=calm"]
    for words in (late, [pair[0], *late, pair[1]]):  # a kind resets what is before it, always
        assert with_files(Config(), words).traffic.truck_share == 0.0
