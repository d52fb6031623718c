"""The settings of Algorithm 1: which go together, and the names that older files gave them."""

import pytest

from drl_av.config import Config, from_toml
from drl_av.config.presets import preset
from drl_av.drivers.policy_file import PRETRAINED
from drl_av.errors import ConfigError


@pytest.mark.parametrize("replay", ["prioritized", "uniform"])
def test_collisions_that_cannot_be_counted_cannot_be_waited_for(replay: str) -> None:
    waiting = Config().updated("learning", collisions_to_start=64, unsafe_penalty=1.0)
    with pytest.raises(ConfigError, match=f"cannot be counted in {replay} replay"):
        waiting.updated("learning", replay=replay)


def test_a_setting_is_read_under_the_name_that_an_older_file_gave_it() -> None:
    older = from_toml("[learning]\nnetworks_take_turns = true\nnetworks = 3\n")
    assert older == Config().updated("learning", round_robin=True, networks=3)
    text = preset("fast").updated("learning", round_robin=True).to_toml()
    assert "networks_take_turns" not in text
    assert from_toml(text.replace("round_robin", "networks_take_turns")) == from_toml(text)


def test_the_shipped_driver_was_written_before_a_setting_was_renamed() -> None:
    assert "networks_take_turns" in (PRETRAINED / "config.toml").read_text(encoding="utf-8")


def test_the_older_name_belongs_to_its_section_alone() -> None:
    with pytest.raises(ConfigError, match="no key 'networks_take_turns'"):
        from_toml("[traffic]\nnetworks_take_turns = true\n")
