"""Reads scenes as JSON, and prints commonroad-crime's TTC and required deceleration of each.

Each scene is [gap_m, ego_m_s, other_m_s, ego_length_m, other_length_m]: the ego follows another
vehicle at constant speeds on a straight road.
"""

import json
import logging
import sys

import numpy as np
from commonroad.geometry.shape import Rectangle
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.scenario import Scenario, ScenarioID
from commonroad.scenario.state import CustomState, InitialState
from commonroad.scenario.trajectory import Trajectory
from commonroad_crime.data_structure.configuration import CriMeConfiguration
from commonroad_crime.measure import TTC, ALongReq

logging.disable(logging.CRITICAL)
SLOPE = 1e-3
"""The road is not quite parallel to x: ALongReq takes a direction of 0 for a missing one."""
DT_S, MOMENTS = 0.1, 4
STEADY = {"acceleration": 0.0, "yaw_rate": 0.0, "slip_angle": 0.0}
CONFIG = CriMeConfiguration()


def vehicle(number: int, s_m: float, speed_m_s: float, length_m: float) -> DynamicObstacle:
    shape = Rectangle(length_m, 1.8)
    states = []
    for moment in range(MOMENTS):
        x = s_m + speed_m_s * DT_S * moment
        place = {"time_step": moment, "position": np.array([x, SLOPE * x])}
        states.append(place | {"velocity": speed_m_s, "orientation": SLOPE} | STEADY)
    later = [CustomState(**s, velocity_y=0.0, acceleration_y=0.0) for s in states[1:]]
    first = InitialState(**states[0])
    first.velocity_y = first.acceleration_y = 0.0
    lanes = {moment: {1} for moment in range(MOMENTS)}
    motion = TrajectoryPrediction(Trajectory(1, later), shape, lanes, lanes)
    return DynamicObstacle(number, ObstacleType.CAR, shape, first, motion, {1}, {1})


def measures(scene):
    gap_m, ego_m_s, other_m_s, ego_length_m, other_length_m = scene
    x = np.arange(-50.0, 260.0, 20.0)
    y = SLOPE * x
    lane = Lanelet(np.c_[x, y + 1.9], np.c_[x, y], np.c_[x, y - 1.9], 1)
    world = Scenario(DT_S, ScenarioID.from_benchmark_id("ZAM_Test-1_1_T-1", "2020a"))
    world.add_objects(LaneletNetwork.create_from_lanelet_list([lane]))
    ahead_m = gap_m + (ego_length_m + other_length_m) / 2
    world.add_objects(
        [vehicle(100, 0.0, ego_m_s, ego_length_m), vehicle(101, ahead_m, other_m_s, other_length_m)]
    )
    CONFIG.update(ego_id=100, sce=world)
    return [TTC(CONFIG).compute(101, 0, False), -ALongReq(CONFIG).compute(101, 0, False)]


print(json.dumps([measures(scene) for scene in json.load(sys.stdin)]))
