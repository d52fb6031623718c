"""The settings of a run: whole, or one sentence, wherever the file was cut."""

from pathlib import Path

import pytest

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.config.reference import annotated_toml
from drl_av.errors import ConfigError
from drl_av.learning.run import load_stored


@pytest.mark.parametrize("written", [annotated_toml, Config.to_toml])
def test_what_a_run_writes_is_what_it_reads(written, tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text(written(preset("fast")), encoding="utf-8")
    assert load_stored(tmp_path / "config.toml") == preset("fast")


def test_no_cut_goes_unnoticed(tmp_path: Path) -> None:
    text, file = annotated_toml(preset("fast")), tmp_path / "config.toml"
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
