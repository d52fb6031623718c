"""Worlds built by hand: a road, an ego, and the vehicles around it.

Distances between vehicles are net gaps, as in the stories that the tests tell: ``ahead(20)`` has
20 m between the ego's front bumper and its rear bumper.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from hypothesis import strategies as st

from drl_av.config import EgoConfig, SimulationConfig
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.affordances import compute_indicators
from drl_av.driving.maneuver import Plan, plan
from drl_av.driving.mirror import Mirror
from drl_av.driving.scene import LaneChange, Scene
from drl_av.road.road import OPEN_LAP_M, PartialLane, Road, is_open
from drl_av.road.snapshot import Snapshot

LENGTH_M, WIDTH_M, LANE_M = 5.0, 1.8, 3.8
RIGHT, CENTER, LEFT = 0.0, 3.8, 7.6
"""Centres of the three lanes."""
ROAD = Road(500.0, LANE_M, (True, True, True))
LONG_ROAD = Road(2000.0, LANE_M, (True, True, True))
BARRICADED_ROAD = Road(500.0, LANE_M, (False, True, True))

MERGE = Road(OPEN_LAP_M, LANE_M, (True,) * 4, 1500.0, (PartialLane(0, 400.0, 800.0, 550.0, 800.0),))
"""An on-ramp from 400 m joins three lanes at 550 m, and its lane ends at 800 m."""
EXIT = Road(
    OPEN_LAP_M, LANE_M, (True,) * 4, 1500.0, (PartialLane(0, 900.0, math.inf, 900.0, 1150.0),)
)
"""A lane begins at 900 m beside three others, and parts from them at 1,150 m as an off-ramp."""
ENDS = ((0, 0.0, 800.0), (1, 0.0, 800.0), (4, 0.0, 900.0), (4, 1000.0, math.inf))
PARTIAL = tuple(PartialLane(lane, begin, end, begin, end) for lane, begin, end in ENDS)
NARROWING = Road(OPEN_LAP_M, LANE_M, (True,) * 5, 1500.0, PARTIAL)
"""Of five lanes the two on the right end at 800 m, and the left one at 900 m; it begins again."""
LEAVE = replace(EXIT, exit_m=1150.0)
"""The same road where the off-ramp is the ego's way."""


class Car(NamedTuple):
    """A vehicle; ``offset_m`` is from the ego's centre to its own, ahead positive."""

    offset_m: float
    y_m: float = CENTER
    speed_m_s: float = 20.0
    lateral_speed_m_s: float = 0.0
    length_m: float = LENGTH_M
    width_m: float = WIDTH_M


def ahead(gap_m: float, y_m: float = CENTER, speed_m_s: float = 20.0, v_y: float = 0.0) -> Car:
    """A car that many metres ahead, bumper to bumper."""
    return Car(gap_m + LENGTH_M, y_m, speed_m_s, v_y)


def behind(gap_m: float, y_m: float = CENTER, speed_m_s: float = 20.0, v_y: float = 0.0) -> Car:
    """A car that many metres behind, bumper to bumper."""
    return Car(-gap_m - LENGTH_M, y_m, speed_m_s, v_y)


def snapshot(
    *others: Car,
    s_m: float = 100.0,
    y_m: float = CENTER,
    speed_m_s: float = 20.0,
    v_y: float = 0.0,
    road: Road = ROAD,
    wish: int = 0,
    time_s: float = 0.0,
) -> Snapshot:
    """The ego at ``s_m``, ``y_m`` with others placed relative to it."""
    cars = (Car(0.0, y_m, speed_m_s, v_y), *others)
    offset_m, y, speed, lateral, length, width = np.array(cars, dtype=np.float64).T
    ids = ("ego", *(f"vehicle{row}" for row in range(1, len(cars))))
    places_m = (s_m + offset_m) % road.lap_m
    return Snapshot(time_s, ids, places_m, y, speed, lateral, length, width, wish)


def scene(
    *others: Car,
    road: Road = ROAD,
    lane_change: LaneChange | None = None,
    range_m: float = 250.0,
    **ego: Any,
) -> Scene:
    """A ``snapshot``, what the ego sees of it, and the lane change it is in."""
    shot = snapshot(*others, road=road, **ego)
    return Scene(shot, compute_indicators(shot, road, range_m), lane_change, road)


def changing(*others: Car, origin: int, target: int, seconds: int, road: Road = ROAD) -> Scene:
    """The ego so many seconds into a lane change, at 20 m/s."""
    sign = 1 if target > origin else -1
    return scene(
        *others,
        y_m=origin * LANE_M + sign * 0.76 * seconds,
        v_y=sign * 0.76,
        lane_change=LaneChange(origin, target),
        road=road,
    )


def after(done: Plan) -> Scene:
    """The scene that the last command of a plan leads to, on an empty road."""
    end = done.commands[-1]
    return scene(
        y_m=end.y_m,
        v_y=end.lateral_speed_m_s,
        speed_m_s=end.speed_m_s,
        lane_change=done.lane_change,
    )


def drive(
    world: Scene, *laterals: Lateral, ego: EgoConfig | None = None, step_s: float = 0.5
) -> list[Scene]:
    """The scenes after each of these decisions at an unchanged speed, on an empty road."""
    simulation = SimulationConfig(step_length_s=step_s)
    scenes = []
    for lateral in laterals:
        action = Action(lateral, Longitudinal.MAINTAIN)
        world = after(plan(world, action, ego or EgoConfig(), simulation))
        scenes.append(world)
    return scenes


def lateral_positions(worlds: list[Scene]) -> list[float]:
    return [float(world.snapshot.y_m[0]) for world in worlds]


TINY_MIRROR = Mirror(
    observation_permutation=np.array([1, 0, 2]),
    observation_sign=np.array([1, 1, -1], np.float32),
    action_permutation=np.array([0, 2, 1]),
)
"""Three indicators: gap right, gap left, own y from the middle of the road; two actions swap."""
ALONE = scene()
SLOW_LEADER = scene(ahead(20.0, speed_m_s=15.0))
"""20 m ahead, closing 5 m/s: T_C is 4 s, and 20 - 3 * 5 = 5 is less than 15."""
BOXED_IN = scene(ahead(20.0, speed_m_s=15.0), behind(20.0), Car(0.0, RIGHT), Car(0.0, LEFT))
"""Slow ahead, close behind, one alongside at either side."""
ACROSS_THE_SEAM = scene(ahead(5.0), behind(9.0), s_m=498.0)
"""The vehicle ahead is at 8 m of the loop, the ego at 498 m."""

CARS = st.builds(
    Car,
    offset_m=st.floats(-250, 249),
    y_m=st.sampled_from([k * 0.76 for k in range(11)]),
    speed_m_s=st.floats(0, 40, width=16),
    lateral_speed_m_s=st.sampled_from([-0.76, 0.0, 0.76]),
    length_m=st.just(LENGTH_M),
    width_m=st.just(WIDTH_M),
)
"""Anywhere on a loop of 500 m, in a lane or on the way between two."""


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """Any traffic around an ego that keeps its lane or is 1 to 4 s into a lane change."""
    road = draw(st.sampled_from([ROAD, BARRICADED_ROAD]))
    lanes = [lane for lane in range(3) if is_open(lane, road)]
    origin = draw(st.sampled_from(lanes))
    targets = [lane for lane in lanes if abs(lane - origin) == 1]
    seconds = draw(st.integers(0, 4))
    lane_change = LaneChange(origin, draw(st.sampled_from(targets))) if seconds else None
    sign = lane_change.sign if lane_change else 0
    return scene(
        *draw(st.lists(CARS, max_size=10, unique_by=lambda car: round(abs(car.offset_m), 6))),
        s_m=draw(st.floats(0, 499)),
        y_m=origin * LANE_M + sign * 0.76 * seconds,
        speed_m_s=draw(st.floats(0, 30)),
        v_y=0.76 * sign,
        road=road,
        lane_change=lane_change,
    )


def seen_from(shot: Snapshot, row: int) -> Snapshot:
    """The same moment with the vehicle of a row as the ego."""
    order = [row, *(other for other in range(len(shot.ids)) if other != row)]
    arrays = ("s_m", "y_m", "speed_m_s", "lateral_speed_m_s", "length_m", "width_m")
    moved = {name: getattr(shot, name)[order] for name in arrays}
    return shot._replace(ids=tuple(shot.ids[other] for other in order), **moved)
