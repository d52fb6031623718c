"""How vehicles start in SUMO."""

from contextlib import closing
from pathlib import Path

import pytest

from drl_av.config import Config
from drl_av.traffic.scenario import (
    PlacedVehicle,
    ScenarioDescription,
    load_scenario,
    write_scenario,
)
from drl_av.traffic.simulation import Simulation
from drl_av.traffic.snapshot import Command


def test_a_vehicle_may_start_as_fast_as_the_road_allows(tmp_path: Path) -> None:
    # SUMO's own departure speed is bounded by the vehicle type's 40 m/s; ours is not
    ego = PlacedVehicle("ego", lane=1, position_m=50.0, speed_m_s=20.0, desired_speed_m_s=30.0)
    fast = PlacedVehicle("fast", lane=0, position_m=90.0, speed_m_s=60.0, desired_speed_m_s=60.0)
    road = ScenarioDescription(circumference_m=2000.0, speed_limit_m_s=60.0, vehicles=(ego, fast))
    write_scenario(tmp_path / "fast", road)
    with closing(Simulation(load_scenario(tmp_path / "fast"), Config())) as simulation:
        start = simulation.reset(seed=0, vehicles=1)
        assert start.speed_m_s.tolist() == [20.0, 60.0]
        after, _ = simulation.advance([Command(20.0, 3.8, 0.0)] * 2)
        assert after.speed_m_s[1] == pytest.approx(60.0, abs=0.5)
