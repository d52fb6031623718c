"""Settings explained: comments that change nothing, units, bounds, and defaults where changed."""

from dataclasses import dataclass, fields
from pathlib import Path

import pytest
from programs import python
from runs import Capsys

from drl_av.cli import main
from drl_av.config import Config, from_toml
from drl_av.config.presets import PRESETS
from drl_av.config.reference import SECTIONS, annotated_toml, settings
from drl_av.config.section import meanings
from drl_av.errors import ConfigError

OF = {(setting.section, setting.key): setting for setting in settings(Config())}


@pytest.mark.parametrize("name", PRESETS)
def test_the_annotated_text_reads_back_as_the_same_config(name: str) -> None:
    assert from_toml(annotated_toml(PRESETS[name])) == PRESETS[name]


@pytest.mark.parametrize("section", SECTIONS)
def test_the_docstring_of_a_section_says_what_each_setting_is_and_names_no_other(
    section: str,
) -> None:
    part = type(getattr(Config(), section))
    assert [*meanings(part)] == [item.name for item in fields(part)]


@dataclass
class Boat:
    """A boat, which is 3 m long (ours).

    sail: cloth that the wind fills (on
        good days) and that falls otherwise (Noah 1999)
    oar_m: length: of an oar (Table I)

    Raises:
        ConfigError: it sinks (ours).
    """

    sail: str = "white"
    oar_m: float = 2.0


def test_a_meaning_goes_on_in_indented_lines_and_ends_with_its_source() -> None:
    assert meanings(Boat) == {
        "sail": ("cloth that the wind fills (on good days) and that falls otherwise", "Noah 1999"),
        "oar_m": ("length: of an oar", "Table I"),
    }


@pytest.mark.parametrize(
    ("section", "key", "unit"),
    [
        *(("ego", "hard_brake_m_s2", "m/s²"), ("ego", "max_speed_m_s", "m/s")),
        *(("ego", "acc_gap_gain_per_s", "1/s"), ("finite_state", "gap_gain_per_s2", "1/s²")),
        ("ego", "max_curvature_per_m", "1/m"),
        *(("safety", "minimum_gap_m", "m"), ("safety", "minimum_ttc_s", "s")),
        *(("learning", "episodes", ""), ("learning", "mirrored", "")),
    ],
)
def test_the_unit_is_that_of_the_name(section: str, key: str, unit: str) -> None:
    assert OF[section, key].unit == unit


@pytest.mark.parametrize(
    ("section", "key", "allowed"),
    [
        ("learning", "replay", "one of two-buffer, prioritized, uniform"),
        ("learning", "mirrored", "true or false"),
        ("learning", "evaluate_every", "at least 1"),
        ("learning", "discount", "0 to 1"),
        ("learning", "seed", "0 to 4294967295"),
        ("ppo", "discount", "0 to 0.9999"),  # the scale of its rewards is 1 - discount
        ("simulation", "scenario", "text"),
    ],
)
def test_what_is_allowed_is_said_in_words(section: str, key: str, allowed: str) -> None:
    assert OF[section, key].allowed == allowed


def test_a_changed_setting_also_names_its_default() -> None:
    changed = Config().updated("safety", brake_ttc_s=4.0, check="strict")
    lines = annotated_toml(changed, "safety").splitlines()
    assert lines[lines.index("brake_ttc_s = 4.0") - 1].endswith("; default: 3.0")
    assert lines[lines.index('check = "strict"') - 1].endswith('; default: "paper"')
    assert "default" not in lines[lines.index("minimum_ttc_s = 3.0") - 1]


def test_the_verb_prints_one_section_of_a_preset_under_a_file(
    tmp_path: Path, capsys: Capsys
) -> None:
    (tmp_path / "mine.toml").write_text("[learning]\nseed = 7\n")
    mine = str(tmp_path / "mine.toml")
    assert main(["config", "learning", "--preset", "large", "--config", mine]) == 0
    printed = capsys.readouterr().out
    assert "[ego]" not in printed
    assert from_toml(printed) == Config().updated("learning", algorithm="ppo", seed=7)


def test_a_misspelt_section_is_refused_with_the_nearest() -> None:
    with pytest.raises(ConfigError, match=r"no section 'trafic' .did you mean 'traffic'"):
        annotated_toml(Config(), "trafic")


def test_without_docstrings_the_settings_are_listed_without_meanings() -> None:
    plain = python("-OO", "-m", "drl_av", "config", "reward")
    assert plain.returncode == 0, plain.stderr
    assert from_toml(plain.stdout) == Config()
