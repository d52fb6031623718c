"""What SUMO is told about each vehicle, and what its drivers make of it."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import libsumo
import numpy as np
import pytest

from drl_av.arrays import FloatArray
from drl_av.config import Config, ObservationConfig
from drl_av.env.highway import HighwayEnv
from drl_av.road.vehicle_types import VEHICLE
from drl_av.scenarios.custom_vehicle_types import CustomVehicleType
from drl_av.scenarios.folder import find_scenario, load_scenario, write_scenario
from drl_av.scenarios.highways import StraightDescription
from drl_av.scenarios.loop import ScenarioDescription
from drl_av.scenarios.open_road import START_M
from drl_av.scenarios.road_description import PlacedVehicle
from drl_av.scenarios.road_types import ROAD_TYPES
from drl_av.simulation.fleet import Fleet
from drl_av.simulation.inflow import Inflow, Last


def test_each_vehicle_gets_the_headway_the_acceleration_and_the_speed_that_were_drawn() -> None:
    with closing(HighwayEnv()) as env:
        env.reset(seed=3, options={"vehicles": 12})
        population, vehicle = env.simulation.fleet.population, env.simulation._sumo.vehicle
        for row, name in enumerate(population.ids[1:], 1):
            told = vehicle.getTau(name), vehicle.getAccel(name), vehicle.getMaxSpeed(name)
            drawn = (
                population.headway_s[row],
                population.acceleration_m_s2[row],
                population.desired_speed_m_s[row],
            )
            assert told == pytest.approx(drawn)
        assert len(set(population.headway_s)) > 10


@contextmanager
def two_cars(folder: Path, accel: float) -> Iterator[Any]:
    """Libsumo with a car of 20 m/s, 30 m behind a slow one; their type has this accel."""
    types = folder / "types.add.xml"
    model = "".join(f' {key}="{value}"' for key, value in VEHICLE.items() if key != "guiShape")
    types.write_text(
        f'<additional><vType id="traffic" carFollowModel="IDM" accel="{accel}" decel="4" '
        f'emergencyDecel="9" length="5" width="1.8"{model}/></additional>'
    )
    net = load_scenario(find_scenario()).network_file
    libsumo.start(["sumo", "-n", str(net), "-a", str(types), "--no-step-log", "--step-length",
                   "0.5", "--lateral-resolution", "3.8", "--insertion-checks", "none"])  # fmt: skip
    try:
        libsumo.route.add("r", ["e0", "e1"])
        for name, position_m, speed in (("slow", 60.0, 10.0), ("fast", 25.0, 20.0)):
            libsumo.vehicle.add(name, "r", "traffic", departSpeed="0")
            libsumo.vehicle.moveTo(name, "e0_0", position_m)
            libsumo.vehicle.setPreviousSpeed(name, speed)
            libsumo.vehicle.setTau(name, 1.1)
            libsumo.vehicle.setAccel(name, 1.5)
            libsumo.vehicle.setMaxSpeed(name, 10.0 if name == "slow" else 20.0)
        yield libsumo.vehicle
    finally:
        libsumo.close()


def idm_m_s2(accel: float, of_type: float) -> float:
    """IDM's acceleration of the fast car (Treiber et al. 2000), integrated by SUMO in one step."""
    speed, gap_m = 20.0, 30.0
    wanted_m = 2.5 + speed * 1.1 + speed * 10.0 / (2 * (of_type * 4) ** 0.5)
    return accel * (1 - (speed / 20.0) ** 4 - (wanted_m / gap_m) ** 2)


def test_the_braking_term_of_sumos_idm_takes_the_accel_of_the_type_not_of_the_vehicle(
    tmp_path: Path,
) -> None:
    braking = {}
    for accel in (1.5, 10.0):
        with two_cars(tmp_path, accel) as vehicle:
            assert vehicle.getAccel("fast") == 1.5
            libsumo.simulationStep()
            braking[accel] = -float(vehicle.getAcceleration("fast"))
    # both accelerate with 1.5 m/s^2, yet brake as their types do: the second brakes too little
    assert braking[1.5] > braking[10.0] + 1.0
    assert -idm_m_s2(1.5, 1.5) > -idm_m_s2(1.5, 10.0) + 1.0


def in_one_lane(folder: Path, kind: str, vehicles: int) -> tuple[Fleet, FloatArray]:
    """Vehicles that often ask for random changes of lanes, and their places: all at 3.8 m."""
    write_scenario(folder / "road", ROAD_TYPES[kind]())
    busy = Config().with_traffic("calm").updated("traffic", random_lane_changes_per_s=1.0)
    fleet = Fleet(load_scenario(folder / "road"), busy)
    fleet.draw(1, vehicles)
    return fleet, np.full(len(fleet.ids), 3.8)


@pytest.mark.parametrize("kind", ["merge", "ramp_to_ramp"])
def test_random_changes_of_lanes_never_lead_into_the_lane_of_a_ramp(
    kind: str, tmp_path: Path
) -> None:
    fleet, y_m = in_one_lane(tmp_path, kind, 40)  # the rightmost lane of the highway
    sides = {side for _ in range(50) for _, side in fleet.lane_changes(0.0, y_m.tolist())}
    assert sides == {1}


@pytest.mark.parametrize("kind", ["loop", "straight"])
def test_only_who_keeps_its_lane_changes_lanes_at_random(kind: str, tmp_path: Path) -> None:
    # SUMO would let a vehicle between two lanes go on into the next one, in front of others
    fleet, y_m = in_one_lane(tmp_path, kind, 20)
    y_m[1::2] += 0.38  # half a second of a lane change
    rows = {row for _ in range(50) for row, _ in fleet.lane_changes(0.0, y_m.tolist())}
    assert rows == set(range(2, len(fleet.ids), 2))


def test_a_vehicle_waits_rather_than_enter_slower_than_the_traffic_permits() -> None:
    start, config = ROAD_TYPES["straight"]().plan().start, Config()
    for rear_m, enters in ((400.0, True), (20.0, False)):
        rng = np.random.default_rng(1)
        inflow = Inflow(rng, 100, start, 5.0, config)
        # behind a vehicle that drives 25 m/s, 15 m ahead, it would have to enter at 11 to 15 m/s
        last = dict.fromkeys(start.lanes, Last(rear_m, 25.0))
        found = inflow.entering(1000.0, last)
        assert (found is not None) is enters
        assert found is None or found.speed_m_s.min() >= 20.0


@pytest.mark.parametrize("kind", [name for name in ROAD_TYPES if name not in ("loop", "imported")])
def test_the_traffic_goes_on_as_far_as_the_ego_sees_after_its_last_decision(kind: str) -> None:
    plan = ROAD_TYPES[kind]().plan()
    last_m, bodies_m = 30.0, 25.0
    assert plan.start.span_m - plan.road.end_m == ObservationConfig().range_m + last_m + bodies_m


def test_an_ego_that_has_passed_the_end_by_28_m_still_sees_a_vehicle_249_m_ahead(
    tmp_path: Path,
) -> None:
    # both drive 30 m/s for ten decisions; before the last one the ego's centre is 2 m short
    end_m = START_M + 300.0
    ego = PlacedVehicle("ego", 1, end_m - 269.5, 30.0, 30.0)
    other = PlacedVehicle("other", 1, ego.position_m + 254.0, 30.0, 30.0)
    write_scenario(tmp_path / "road", StraightDescription(length_m=300.0, vehicles=(ego, other)))
    with closing(HighwayEnv(tmp_path / "road", config={"safety": {"check": "paper"}})) as env:
        env.reset(seed=1)
        ends = [env.step(0)[3] for _ in range(10)]
        assert ends == [False] * 9 + [True]
        assert env.scene.snapshot.s_m[0] == pytest.approx(end_m + 28.0)
        assert env.indicators[0] == pytest.approx(249.0, abs=0.1)  # own_front_d_x


LORRY = CustomVehicleType(
    "lorry", 0.5, 16.5, 2.5, acceleration_m_s2=0.8, top_speed_m_s=22.0, headway_s=2.0,
    speed_gain=3.0, shape="truck/semitrailer",
)  # fmt: skip


@pytest.mark.parametrize("kind", ["loop", "straight"])
def test_a_lorry_is_a_lorry_in_acceleration_speed_headway_and_shape(
    kind: str, tmp_path: Path
) -> None:
    description = (
        ScenarioDescription(vehicle_types=(LORRY,), circumference_m=1000.0)
        if kind == "loop"
        else ROAD_TYPES[kind](vehicle_types=(LORRY,))
    )
    write_scenario(tmp_path / "road", description)
    assert load_scenario(tmp_path / "road").description.vehicle_types == (LORRY,)
    strict = Config().updated("safety", check="strict")
    with closing(HighwayEnv(tmp_path / "road", config=strict)) as env:
        env.reset(seed=2, options={"vehicles": 20})
        for _ in range(12 if kind == "straight" else 1):
            fleet, vehicle = env.simulation.fleet, env.simulation._sumo.vehicle
            for name, of_type in zip(fleet.ids, fleet.type_ids, strict=True):
                if of_type == "lorry":
                    assert vehicle.getAccel(name) == 0.8
                    assert vehicle.getTau(name) == 2.0
                    gain = vehicle.getParameter(name, "laneChangeModel.lcSpeedGain")
                    assert float(gain) == 3.0
                    assert vehicle.getMaxSpeed(name) <= 22.0
                    assert vehicle.getShapeClass(name) == "truck/semitrailer"
                    assert vehicle.getLength(name) == 16.5
                    assert vehicle.getSpeed(name) <= 22.0 + 1e-6
                elif name != "ego":
                    assert vehicle.getShapeClass(name) == "passenger"
                    assert vehicle.getAccel(name) >= 1.0
            assert "lorry" in fleet.type_ids
            env.step(0)


def test_vehicles_behind_a_lorry_start_slow_enough_to_stop(tmp_path: Path) -> None:
    slow = CustomVehicleType("slow", 0.5, 10.0, 2.5, top_speed_m_s=2.0)
    write_scenario(tmp_path / "road", ScenarioDescription(vehicle_types=(slow,)))
    strict = Config().updated("safety", check="strict")
    with closing(HighwayEnv(tmp_path / "road", config=strict)) as env:
        for seed in range(10):
            env.reset(seed=seed, options={"vehicles": 25})
            shot = env.scene.snapshot
            for row in range(1, len(shot.ids)):
                same = np.abs(shot.y_m - shot.y_m[row]) < 0.1
                ahead_m = (shot.s_m - shot.s_m[row]) % env.road.lap_m
                ahead_m[~same | (np.arange(len(shot.ids)) == row)] = np.inf
                leader = int(ahead_m.argmin())
                gap_m = ahead_m[leader] - (shot.length_m[row] + shot.length_m[leader]) / 2
                if np.isfinite(gap_m):
                    # both brake with 2 m/s^2, and 2.5 m remain
                    reach_m = (shot.speed_m_s[row] ** 2 - shot.speed_m_s[leader] ** 2) / 4
                    assert reach_m <= max(gap_m - 2.5, 0.0) + 1e-6


def test_a_scenario_file_has_only_what_the_user_states_of_a_type() -> None:
    plain = CustomVehicleType("van", 0.5, 7.0, 2.2)
    text = ScenarioDescription(vehicle_types=(plain, LORRY), circumference_m=900.0).to_toml()
    van, lorry = text.split("[[vehicle_types]]")[1:]
    assert "headway_s" not in van
    assert "shape" not in van
    assert "headway_s = 2.0" in lorry
