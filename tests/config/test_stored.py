"""The settings of a run: whole, or one sentence, wherever the file was cut."""

from pathlib import Path

import pytest

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.config.reference import annotated_toml
from drl_av.config.stored import ADDED_LATER, load_stored
from drl_av.errors import ConfigError

OLD = Path(__file__).with_name("before_traffic_kinds.toml")
"""What runs stored before traffic came in kinds, and before SUMO drove the ego."""


@pytest.mark.parametrize("written", [annotated_toml, Config.to_toml])
def test_what_a_run_writes_is_what_it_reads(written, tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text(written(preset("fast")), encoding="utf-8")
    assert load_stored(tmp_path / "config.toml") == preset("fast")


def test_a_run_begun_before_a_setting_existed_takes_its_default() -> None:
    found = load_stored(OLD)
    assert found.learning.episodes == 1000
    assert found.learning.safe_capacity == 300_000
    for section, key in ADDED_LATER:
        assert f"{key} =" not in OLD.read_text().split(f"[{section}]")[1].split("[")[0]
        assert getattr(getattr(found, section), key) == getattr(getattr(Config(), section), key)


@pytest.mark.parametrize("young", [True, False])
def test_no_cut_goes_unnoticed(young: bool, tmp_path: Path) -> None:
    text = annotated_toml(preset("fast")) if young else OLD.read_text()
    file = tmp_path / "config.toml"
    for length in [*range(0, len(text), 97), *range(len(text) - 40, len(text))]:
        file.write_text(text[:length], encoding="utf-8")
        with pytest.raises(ConfigError, match=r"config\.toml") as error:
            load_stored(file)
        assert str(error.value).endswith(".")
        assert "\n" not in str(error.value)


def test_a_lost_section_and_a_lost_setting_are_named(tmp_path: Path) -> None:
    file, whole = tmp_path / "config.toml", Config().to_toml()
    mobil = whole[whole.index("[mobil]") : whole.index("[finite_state]")]
    lost = {"hidden_units = 100\n": "learning.hidden_units", mobil: "mobil.politeness"}
    for part, named in lost.items():
        file.write_text(whole.replace(part, ""), encoding="utf-8")
        with pytest.raises(ConfigError, match=f"it lacks {named}"):
            load_stored(file)
