"""How vehicles start in SUMO."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from drl_av.config import Config
from drl_av.road.snapshot import Command
from drl_av.scenarios.folder import (
    PlacedVehicle,
    ScenarioDescription,
    find_scenario,
    load_scenario,
    write_scenario,
)
from drl_av.simulation.simulation import Simulation
from drl_av.simulation.vehicle_calls import EgoModel


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


def moved_left_and_right(rate_per_s: float) -> tuple[int, int]:
    """Of 20 vehicles, those that are left and right of their first lane after 60 s."""
    config = Config().updated("traffic", random_lane_changes_per_s=rate_per_s)
    with closing(Simulation(load_scenario(find_scenario()), config)) as simulation:
        start = simulation.reset(seed=3, vehicles=20)
        ego = Command(float(start.speed_m_s[0]), float(start.y_m[0]), 0.0)
        for _ in range(60):
            end, _ = simulation.advance([ego] * 2)
    lanes = np.round((end.y_m - start.y_m)[1:] / 3.8)
    return int((lanes > 0).sum()), int((lanes < 0).sum())


def test_traffic_changes_lanes_at_random_to_both_sides_and_not_at_all_without_a_rate() -> None:
    left, right = moved_left_and_right(0.05)
    assert left >= 2
    assert right >= 2
    assert moved_left_and_right(0.0) == (0, 0)


@pytest.mark.parametrize(("overtake_right", "passed"), [(False, False), (True, True)])
def test_on_the_right_sumo_passes_a_vehicle_of_22_m_s_only_where_that_is_allowed(
    overtake_right: bool, passed: bool, tmp_path: Path
) -> None:
    # 100 m behind, 10 m/s faster: 600 m further after a minute, were it not for the rule
    slow, fast = PlacedVehicle("slow", 2, 160.0, 22.0, 22.0), PlacedVehicle("fast", 1, 60, 30, 32)
    placed = (PlacedVehicle("ego", 0, 1000.0, 0.0, 30.0), slow, fast)
    write_scenario(tmp_path / "s", ScenarioDescription(circumference_m=2000.0, vehicles=placed))
    traffic = {"overtake_right": overtake_right, "random_lane_changes_per_s": 0.0}
    config = Config().updated("traffic", **traffic)
    with closing(Simulation(load_scenario(tmp_path / "s"), config)) as simulation:
        simulation.reset(1, 2)
        for _ in range(60):
            shot, _ = simulation.advance([Command(0.0, 0.0, 0.0)] * 2)
    slow_row, fast_row = shot.ids.index("slow"), shot.ids.index("fast")
    ahead_m = float(simulation.road.ahead_m(shot.s_m[slow_row], shot.s_m[fast_row]))
    assert (ahead_m > 400) == passed
    assert ahead_m > -60
    assert shot.speed_m_s[fast_row] == pytest.approx(32.0 if passed else 22.0, abs=0.01)


def test_a_truck_is_as_long_and_wide_in_sumo_as_in_the_snapshot_and_cars_stop_behind_it() -> None:
    # they accelerate weakly, so that SUMO's IDM alone would hit the vehicle ahead
    sizes = {"truck_share": 0.5, "truck_length_m": 16.0, "truck_width_m": 2.5}
    config = Config().updated("traffic", keep_stopping_distance=True, **sizes)
    with closing(Simulation(load_scenario(find_scenario()), config)) as simulation:
        shot = simulation.reset(seed=5, vehicles=30)
        assert set(shot.length_m.tolist()) == {5.0, 16.0}
        assert shot.length_m[0] == 5.0
        trucks = np.flatnonzero(shot.length_m == 16.0)
        assert (shot.width_m[trucks] == 2.5).all()
        vehicle = simulation._sumo.vehicle
        for row, name in enumerate(shot.ids):
            assert vehicle.getLength(name) == shot.length_m[row]
            assert vehicle.getWidth(name) == shot.width_m[row]
            # a centre is half a length behind the front bumper
            lane, start_m = simulation.scenario.layout.lane_positions[vehicle.getLaneID(name)]
            front_m = start_m + vehicle.getLanePosition(name)
            assert (front_m - shot.s_m[row]) % 500.0 == pytest.approx(shot.length_m[row] / 2)
            assert shot.y_m[row] == pytest.approx(3.8 * lane)
        simulation.hand_over(EgoModel())
        for _ in range(150):
            shot, hit = simulation.advance([Command(0.0, 0.0, 0.0)] * 2)
            assert hit is None
            between_m = np.abs(shot.s_m[:, None] - shot.s_m)
            apart_m = np.minimum(between_m, 500.0 - between_m)
            halves_m = (shot.length_m[:, None] + shot.length_m) / 2
            beside_m = np.abs(shot.y_m[:, None] - shot.y_m)
            touching = (apart_m < halves_m) & (
                beside_m < (shot.width_m[:, None] + shot.width_m) / 2
            )
            assert touching.sum() == len(shot.ids)  # each with itself
