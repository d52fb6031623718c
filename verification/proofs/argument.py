"""The exact numbers that the argument of ``strict`` rests on, as a config and its scenario say."""

from dataclasses import dataclass
from fractions import Fraction
from math import floor

from drl_av.config import Config
from drl_av.driving.actions import Longitudinal
from drl_av.errors import ConfigError
from drl_av.traffic.scenario import find_scenario, load_scenario


@dataclass(frozen=True)
class Argument:
    """What the check assumes; then what the vehicles really do, which a mutant changes."""

    step_s: Fraction
    steps: int
    """SUMO steps in a decision."""
    most_m_s: Fraction
    """The ego's highest speed."""
    rates_m_s2: tuple[Fraction, ...]
    """Of the four longitudinal actions, in the order of ``Longitudinal``."""
    by_number: bool
    """Whether an action moves the ego by its number alone, and no car-following model does."""
    hard_m_s2: Fraction
    braking_m_s2: Fraction
    acceleration_m_s2: Fraction
    lateral_m_s: Fraction
    response_s: Fraction
    follower_m_s2: Fraction
    """Braking that a vehicle behind is counted on for."""
    clearance_m: Fraction
    change_s: Fraction
    """Duration of a lane change."""
    lane_m: Fraction
    width_m: Fraction
    """Of every vehicle's body."""
    others_most_m_s: Fraction = Fraction(60)
    lead_braking_m_s2: Fraction = Fraction(0)
    """Hardest braking of a vehicle ahead."""
    response_steps: int = 0
    """SUMO steps after which a vehicle behind brakes for the ego in its lane."""
    cut_in_steps: int = 0
    """SUMO steps that the ego goes on for in the gap that a vehicle cutting in leaves."""
    abort_decisions: int = 1
    """Decisions until the ego answers a vehicle that enters its target lane."""

    @property
    def decision_s(self) -> Fraction:
        return self.steps * self.step_s

    @property
    def stride_m(self) -> Fraction:
        """How far a lane change moves the ego sideways in one decision."""
        return self.lane_m / self.change_s * self.decision_s


def exact(number: float) -> Fraction:
    """The number as it is written: 0.1 is a tenth."""
    return Fraction(repr(number))


def argument(config: Config) -> Argument:
    """The numbers of a config.

    Raises:
        ConfigError: the lateral plant is not the one that the lemmas on lane changes describe.
        ScenarioError: the scenario cannot be read.
    """
    ego, strict, simulation = config.ego, config.strict, config.simulation
    if ego.lateral_plant != "kinematic":
        raise ConfigError(
            f"ego.lateral_plant is {ego.lateral_plant!r}, but the lemma corridor describes "
            "'kinematic' alone: take that."
        )
    scenario = load_scenario(find_scenario(simulation.scenario)).description
    step_s, response_s = exact(simulation.step_length_s), exact(strict.follower_response_s)
    return Argument(
        step_s,
        simulation.steps_per_decision,
        exact(ego.max_speed_m_s),
        tuple(exact(how.acceleration_m_s2(ego)) for how in Longitudinal),
        ego.longitudinal_reference == "acceleration",
        exact(ego.hard_brake_m_s2),
        exact(strict.braking_m_s2),
        exact(strict.acceleration_m_s2),
        exact(strict.lateral_speed_m_s),
        response_s,
        exact(strict.follower_braking_m_s2),
        exact(strict.clearance_m),
        exact(ego.lane_change_duration_s),
        exact(scenario.lane_width_m),
        exact(scenario.vehicle_width_m),
        lead_braking_m_s2=exact(strict.braking_m_s2),
        response_steps=floor(response_s / step_s),
        cut_in_steps=simulation.steps_per_decision,
    )
