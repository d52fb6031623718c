"""The kinds of traffic of an environment, with a simulation and background drivers for each.

With the setting ``traffic.all_kinds`` each episode draws its kind. Otherwise there is one kind.
"""

from collections.abc import Sequence
from typing import NamedTuple

from drl_av.config import Config
from drl_av.drivers.background.level_k import load_level_1
from drl_av.drivers.background.traffic import TrafficDrivers
from drl_av.random_streams import Stream, generator
from drl_av.scenarios.folder import Scenario
from drl_av.simulation.simulation import Simulation


class TrafficSetup(NamedTuple):
    """The traffic of one kind."""

    simulation: Simulation
    drivers: TrafficDrivers


def traffic_setups(config: Config, scenario: Scenario, gui: bool) -> list[TrafficSetup]:
    """Return the traffic of each kind that an episode may have; often there is only one.

    Raises the errors of ``Simulation``.
    """
    found = []
    for each in config.of_each_kind:
        level_1 = load_level_1(scenario.road) if each.traffic.level_1_share else None
        drivers = TrafficDrivers(each, scenario.road, scenario.vehicle_types, level_1)
        found.append(TrafficSetup(Simulation(scenario, each, gui), drivers))
    return found


def drawn_traffic(kinds: Sequence[TrafficSetup], seed: int, before: Simulation) -> TrafficSetup:
    """Draw the traffic of an episode from its seed, and return it.

    ``before`` is the simulation of the previous episode. If the episode has another simulation,
    ``before`` is closed, and the new one calls the same ``after_step``.
    """
    drawn = kinds[int(generator(seed, Stream.KIND_OF_TRAFFIC).integers(len(kinds)))]
    if drawn.simulation is not before:
        before.close()
        drawn.simulation.after_step = before.after_step
    return drawn
