"""Kinds of traffic by name, on the command line, in a file and in a program."""

from dataclasses import fields
from pathlib import Path

import pytest

from drl_av import cli
from drl_av.config import TRAFFIC_PRESETS, Config, TrafficConfig, from_toml, load_config
from drl_av.config.presets import as_config
from drl_av.config.traffic import traffic_preset
from drl_av.errors import ConfigError

KINDS = tuple(TRAFFIC_PRESETS)


def test_calm_is_the_default() -> None:
    assert Config().with_traffic("calm") == Config()


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_names_settings_that_are_there_and_says_where_they_come_from(name: str) -> None:
    known = {item.name for item in fields(TrafficConfig)} - {"vehicles_min", "vehicles_max"}
    kind = TRAFFIC_PRESETS[name]
    assert set(kind.settings) <= known
    assert kind.meaning
    found = traffic_preset(name, TrafficConfig())
    for key, (value, source) in kind.settings.items():
        assert source
        assert getattr(found, key) == value


def test_a_kind_keeps_the_number_of_vehicles_and_nothing_else() -> None:
    before = TrafficConfig(vehicles_min=3, vehicles_max=7, random_lane_changes_per_s=0.5)
    found = traffic_preset("overtaking", before)
    assert (found.vehicles_min, found.vehicles_max) == (3, 7)
    assert found.random_lane_changes_per_s == 0.002


def test_a_file_lays_its_other_keys_over_the_kind() -> None:
    text = '[traffic]\nspeed_gain_max = 3.0\nkind = "overtaking"\nvehicles_max = 12\n'
    found = from_toml(text).traffic
    assert (found.speed_gain_min, found.speed_gain_max, found.vehicles_max) == (1.0, 3.0, 12)
    wanted = {"traffic": {"kind": "overtaking", "speed_gain_max": 3.0, "vehicles_max": 12}}
    assert as_config(wanted).traffic == found


def test_what_is_saved_holds_the_numbers() -> None:
    config = Config().with_traffic("hazards")
    assert "\nkind" not in config.to_toml()
    assert from_toml(config.to_toml()) == config


def test_an_unknown_kind_is_reported_with_the_nearest() -> None:
    with pytest.raises(ConfigError, match=r"'hazard' \(did you mean 'hazards'\?\); the kinds are:"):
        from_toml('[traffic]\nkind = "hazard"\n')
    with pytest.raises(ConfigError, match=r"no kind of traffic 5; the kinds"):
        from_toml("[traffic]\nkind = 5\n")


def test_the_command_line_takes_a_kind_and_lays_a_file_over_it(tmp_path: Path) -> None:
    file = tmp_path / "few.toml"
    file.write_text("[traffic]\nvehicles_max = 3\nspeed_gain_max = 2.0\n")
    words = ["train", "--traffic", "overtaking", "--config", str(file), "--episodes", "1"]
    assert cli.main([*words, "--out", str(tmp_path / "run")]) == 0
    found = load_config(tmp_path / "run" / "config.toml").traffic
    assert (found.speed_gain_min, found.speed_gain_max, found.vehicles_max) == (1.0, 2.0, 3)
