"""Settings of the scenario and of the simulation steps."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from drl_av.config.section import Section, setting
from drl_av.errors import ConfigError

ONE_STRIP_M = 3.8
"""From this ``lateral_resolution_m`` on, each lane is one strip: the lane width of the paper."""

WORLDS = ("sumo", "twin")


@dataclass(frozen=True)
class SimulationConfig(Section):
    """The scenario, and the time steps of SUMO and of the decisions.

    scenario: path of a scenario folder, or name of a shipped scenario (ours)
    world: sumo, or twin: SUMO's traffic, compiled (ours)
    step_length_s: length of a SUMO step; must divide one second (ours)
    decisions_per_episode: N_s, largest number of decisions in an episode (Sec. IV-C)
    lateral_resolution_m: width of a strip of SUMO's sublane model; from 3.8 m on, one strip per
        lane, also in wider lanes (ours)
    """

    decision_interval_s: ClassVar[float] = 1.0
    """Time between two decisions (Table I); it cannot be set."""
    scenario: str = "circular_three_lane"
    world: str = setting("sumo", choices=WORLDS)
    step_length_s: float = setting(0.5, low=0.01, high=1.0)
    decisions_per_episode: int = setting(200, low=1, high=100_000)
    lateral_resolution_m: float = setting(3.8, low=0.1, high=10.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        steps = self.decision_interval_s / self.step_length_s
        milliseconds = 1000 * self.step_length_s
        if not all(
            math.isclose(number, round(number), abs_tol=1e-9) for number in (steps, milliseconds)
        ):
            raise ConfigError(
                f"simulation.step_length_s is {self.step_length_s}, but must divide the "
                f"{self.decision_interval_s:g} s between decisions, and be a whole number of "
                "milliseconds, as SUMO's times are: try 1, 0.5, 0.25, 0.2 or 0.1."
            )

    @cached_property
    def steps_per_decision(self) -> int:
        """Number of SUMO steps in one decision."""
        return round(self.decision_interval_s / self.step_length_s)

    def strip_width_m(self, lane_width_m: float) -> float:
        """Return the width of a strip on a road with lanes of this width, metres."""
        own_m = self.lateral_resolution_m
        return own_m if own_m < ONE_STRIP_M else max(own_m, lane_width_m)
