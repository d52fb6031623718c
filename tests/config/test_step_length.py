"""The length of a SUMO step: a part of a decision, in SUMO's whole milliseconds."""

import pytest

from drl_av.config import Config
from drl_av.errors import ConfigError


@pytest.mark.parametrize(("step_s", "steps"), [(1.0, 1), (0.5, 2), (0.2, 5), (0.125, 8), (0.1, 10)])
def test_a_decision_has_a_whole_number_of_steps(step_s: float, steps: int) -> None:
    config = Config().updated("simulation", step_length_s=step_s)
    assert config.simulation.steps_per_decision == steps


@pytest.mark.parametrize("step_s", [0.3, 0.4, 1 / 3, 0.0625])  # SUMO would take 0.333 and 0.063
def test_other_steps_are_refused(step_s: float) -> None:
    with pytest.raises(ConfigError, match=r"must divide the 1 s .* whole number of milliseconds"):
        Config().updated("simulation", step_length_s=step_s)
