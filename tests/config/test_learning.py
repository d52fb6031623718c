"""The settings of Algorithm 1: which go together."""

import pytest

from drl_av.config import Config
from drl_av.errors import ConfigError


@pytest.mark.parametrize("replay", ["prioritized", "uniform"])
def test_collisions_that_cannot_be_counted_cannot_be_waited_for(replay: str) -> None:
    waiting = Config().updated("learning", collisions_to_start=64, unsafe_penalty=1.0)
    with pytest.raises(ConfigError, match=f"cannot be counted in {replay} replay"):
        waiting.updated("learning", replay=replay)
