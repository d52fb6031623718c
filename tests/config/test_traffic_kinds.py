"""Kinds of traffic by name, on the command line, in a file and in a program."""

from dataclasses import asdict
from pathlib import Path

import pytest

from drl_av import cli
from drl_av.config import TRAFFIC_PRESETS, Config, TrafficConfig, from_toml, load_config
from drl_av.config.presets import as_config, preset
from drl_av.config.traffic import PAPER_SHARES, traffic_preset
from drl_av.errors import ConfigError

KINDS = tuple(TRAFFIC_PRESETS)
CALM = {
    **{"vehicles_min": 1, "vehicles_max": 30, "presets": ()},
    **{"desired_speed_min_m_s": 20.0, "desired_speed_max_m_s": 32.0},
    **{"headway_min_s": 0.8, "headway_max_s": 1.4},
    **{"acceleration_min_m_s2": 1.0, "acceleration_max_m_s2": 2.0},
    **{"speed_gain_min": 0.0, "speed_gain_max": 0.0, "random_lane_changes_per_s": 0.002},
    **{"lane_evenness": 2.0, "start_gap_m": 8.0},
    **{"finite_state_share": 0.0, "level_0_share": 0.0, "level_1_share": 0.0, "level_2_share": 0.0},
    **{"keep_stopping_distance": True, "overtake_right": False},
    **{"standing_share": 0.0, "crawling_share": 0.0, "crawling_speed_max_m_s": 8.0},
    **{"fast_share": 0.0, "fast_speed_m_s": 38.0, "fast_speed_gain": 5.0},
    **{"hard_braking_share": 0.0, "hard_brakes_per_s": 0.02, "hard_brake_s": 3},
    **{"truck_share": 0.0, "truck_length_m": 12.0, "truck_width_m": 2.5},
    **{"truck_speed_min_m_s": 22.0, "truck_speed_max_m_s": 27.0, "truck_acceleration_m_s2": 0.7},
}
"""Every setting of calm traffic, written out."""
BESIDE_CALM = {
    "calm": {},
    "paper": {"finite_state_share": 0.25, "level_0_share": 0.25, "level_1_share": 0.25},
    "overtaking": {"speed_gain_min": 1.0, "speed_gain_max": 1.0},
    "naturalistic": {
        **{"desired_speed_min_m_s": 34.0, "desired_speed_max_m_s": 40.0},
        **{"headway_min_s": 0.5, "headway_max_s": 0.87},
        **{"acceleration_min_m_s2": 0.67, "acceleration_max_m_s2": 1.71},
        **{"speed_gain_min": 0.6, "speed_gain_max": 0.6, "random_lane_changes_per_s": 0.0},
        **{"overtake_right": True, "truck_share": 0.1, "truck_acceleration_m_s2": 0.67},
        **{"truck_speed_min_m_s": 25.0, "truck_speed_max_m_s": 28.0},
    },
    "hazards": {
        **{"speed_gain_min": 1.0, "speed_gain_max": 1.0, "random_lane_changes_per_s": 0.01},
        **{"standing_share": 0.01, "crawling_share": 0.02, "fast_share": 0.1},
        **{"hard_braking_share": 0.15},
    },
    "all": {"presets": ("calm", "paper", "overtaking", "naturalistic", "hazards")},
}
"""What differs from calm in each kind of traffic, written out."""


def test_the_papers_own_traffic_is_the_default() -> None:
    assert Config().with_traffic("paper") == Config() == preset("paper")
    assert preset("literal").traffic == Config().traffic


def test_presets_that_stood_on_calm_name_it() -> None:
    for name in ("paper-merge", "paper-exit", "paper-ramp_to_ramp"):
        assert asdict(preset(name).traffic) == CALM


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_has_these_settings_and_no_others(name: str) -> None:
    assert asdict(Config().with_traffic(name).traffic) == CALM | BESIDE_CALM[name]


def test_kinds_to_draw_leave_no_share_of_the_papers_drivers_beside_them() -> None:
    written = [*(f"{name} = 0.0" for name in PAPER_SHARES), 'presets = ["paper", "calm"]']
    for lines in (written[-1:], written):  # as files have it from now on, and from before
        found = from_toml("\n".join(["[traffic]", *lines])).traffic
        assert found.shares == (0.0, 0.0, 0.0, 0.0, 0.0)
        kinds = Config(traffic=found).per_traffic_preset
        assert [each.traffic.level_1_share for each in kinds] == [0.25, 0.0]
    with pytest.raises(ConfigError, match="only vehicles_min, vehicles_max, keep_stopping"):
        from_toml('[traffic]\npresets = ["paper"]\nlevel_1_share = 0.5\n')
    with pytest.raises(ConfigError, match=r"has kind and presets.*: leave one of them out"):
        from_toml('[traffic]\nkind = "calm"\npresets = ["paper"]\n')


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


def test_settings_of_another_kind_beside_a_named_kind_are_refused(tmp_path: Path) -> None:
    file, run = tmp_path / "own.toml", tmp_path / "config.toml"
    file.write_text('[traffic]\nkind = "paper"\nspeed_gain_max = 3.0\n')
    run.write_text(Config().to_toml())  # that of a training, which names no kind
    told = r"The traffic is calm, but .* have the traffic paper: .*-o traffic\.kind=calm"
    for given in (file, run, {"traffic": {"kind": "paper"}}):
        with pytest.raises(ConfigError, match=told):
            as_config(given, traffic="calm")
    hazards = Config().with_traffic("hazards").to_toml()  # it changes lanes as overtaking does
    run.write_text(hazards)
    with pytest.raises(ConfigError, match=r"is calm, but .* have the traffic hazards: leave"):
        as_config(run, traffic="calm")
    single = {"traffic": {"finite_state_share": 0.25, "vehicles_max": 9}}
    assert as_config(single, traffic="calm").traffic.shares == (0.25, 0.0, 0.0, 0.0, 0.0)
    assert as_config(file, traffic="paper").traffic.speed_gain_max == 3.0
    assert as_config(file).traffic.speed_gain_max == 3.0


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
