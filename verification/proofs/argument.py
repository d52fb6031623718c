"""Collects the exact numbers on which the safety argument of ``strict`` depends, from a config."""

from dataclasses import dataclass
from fractions import Fraction
from math import floor

from drl_av.config import Config
from drl_av.driving.actions import Longitudinal
from drl_av.errors import ConfigError
from drl_av.safety.reachability import FASTEST_M_S
from drl_av.scenarios.folder import find_scenario, load_scenario


@dataclass(frozen=True)
class Argument:
    """The numbers of the safety argument of ``strict``, as exact fractions in SI units.

    The fields without a default are the assumptions of the check. The fields with a default
    describe what the vehicles really do; if a test changes them, the proof must fail.
    """

    step_s: Fraction
    steps: int
    """Number of SUMO steps in a decision."""
    most_m_s: Fraction
    """The ego's maximum speed."""
    rates_m_s2: tuple[Fraction, ...]
    """Accelerations of the four longitudinal actions, in the order of ``Longitudinal``."""
    by_number: bool
    """Whether the action alone sets the ego's acceleration; False with a car-following model."""
    hard_m_s2: Fraction
    braking_m_s2: Fraction
    acceleration_m_s2: Fraction
    lateral_m_s: Fraction
    response_s: Fraction
    follower_m_s2: Fraction
    """Braking that the check expects of a vehicle behind (positive)."""
    clearance_m: Fraction
    change_s: Fraction
    """Duration of a lane change."""
    lane_m: Fraction
    width_m: Fraction
    """Width of the ego's body."""
    widths_m: tuple[Fraction, ...]
    """Widths of the bodies of the other vehicles."""
    others_most_m_s: Fraction = Fraction(FASTEST_M_S)
    lead_braking_m_s2: Fraction = Fraction(0)
    """Hardest braking of a vehicle ahead."""
    response_steps: int = 0
    """Number of SUMO steps after which a vehicle behind brakes for the ego in its lane."""
    cut_in_steps: int = 0
    """Number of SUMO steps for which the ego keeps its acceleration after a cut-in begins."""
    abort_decisions: int = 1
    """Number of decisions until the ego reacts to a vehicle that enters its target lane."""

    @property
    def decision_s(self) -> Fraction:
        return self.steps * self.step_s

    @property
    def stride_m(self) -> Fraction:
        """Distance that a lane change moves the ego sideways in one decision."""
        return self.lane_m / self.change_s * self.decision_s


def exact(number: float) -> Fraction:
    """Return the decimal number that Python prints for a float: 1/10 for 0.1."""
    return Fraction(repr(number))


def argument(config: Config) -> Argument:
    """Return the numbers that follow from a config and its scenario.

    Raises:
        ConfigError: ``ego.lateral_plant`` is not ``kinematic``, which the lemmas describe.
        ScenarioError: the scenario cannot be read.
    """
    ego, strict, simulation = config.ego, config.strict, config.simulation
    if ego.lateral_plant != "kinematic":
        raise ConfigError(
            f"ego.lateral_plant is {ego.lateral_plant!r}, but the lemma corridor describes "
            "'kinematic' alone: take that."
        )
    scenario = load_scenario(find_scenario(simulation.scenario))
    types, traffic = scenario.vehicle_types, [one.traffic for one in config.per_traffic_preset]
    widths_m = {kind.width_m for kind in types.others.values()}
    widths_m |= {each.truck_width_m for each in traffic if each.truck_share}
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
        exact(scenario.road.lane_width_m),
        exact(types.ego.width_m),
        tuple(map(exact, sorted(widths_m))),
        lead_braking_m_s2=exact(strict.braking_m_s2),
        response_steps=floor(response_s / step_s),
        cut_in_steps=simulation.steps_per_decision,
    )
