"""The road and the vehicles around one vehicle of any SUMO simulation, as ours describe them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from drl_av.config import EgoConfig
from drl_av.errors import SimulationError
from drl_av.road.road import OPEN_LAP_M, PartialLane, Road, SpeedLimit
from drl_av.road.snapshot import Snapshot
from drl_av.road.vehicle_types import AS_WRITTEN, VehicleType, VehicleTypes
from drl_av.simulation.vehicle_calls import getters, take_control

ORIGIN_M = OPEN_LAP_M / 2
"""Position along our road at which the vehicle's present edge begins."""
SAME_WIDTH_M = 0.01
"""Lanes whose widths differ by less have the same width."""
STATE = (
    *("getLaneID", "getLanePosition", "getLateralLanePosition", "getSpeed", "getLateralSpeed"),
    *("getLength", "getWidth"),
)
EGO_TAU_S = 1.5
"""SUMO's tau of an ego: others leave it the room for one decision in which it accelerates."""


class Strip(NamedTuple):
    """A lane of SUMO as a part of our road: the index of its lane, and where it begins."""

    lane: int
    begin_m: float


class Surroundings:
    """Reads the surroundings of the vehicle ``name`` along its route; ours, for ``attach``.

    ``sumo`` is the module libsumo or traci, or a traci connection. A lane goes on in the lane to
    which SUMO connects it, and ends where it does not lead on along the route. A lane that is
    closed to the vehicle's class does not exist.

    Raises:
        SimulationError: SUMO has no such vehicle on the road, or the lanes of its route differ in
            width.
    """

    def __init__(self, sumo: Any, name: str, range_m: float) -> None:
        self._sumo, self._name, self._range_m = sumo, name, range_m
        if name not in sumo.vehicle.getIDList():
            raise SimulationError(
                f"There is no vehicle {name!r} on the road: attach it once it has departed."
            )
        self._length_m = {lane: sumo.lane.getLength(lane) for lane in sumo.lane.getIDList()}
        self._after: dict[str, list[tuple[str, str]]] = {}
        self._before: dict[str, list[str]] = {}
        for lane in self._length_m:
            for approached, _, _, _, via, *_ in sumo.lane.getLinks(lane):
                self._after.setdefault(lane, []).append((approached, via or approached))
                self._before.setdefault(via or approached, []).append(lane)
        self._getters = getters(sumo, STATE)
        self._edge = ""
        self._strips: dict[str, Strip] = {}
        self._ends_m: dict[int, float] = {}
        self._closed: set[int] = set()
        self.lane_width_m = self._lane_width_m()
        """The width of each lane of the route, metres."""

    @property
    def is_on_the_road(self) -> bool:
        """Whether SUMO still drives the vehicle: it has not arrived and was not removed."""
        return self._name in self._sumo.vehicle.getIDList()

    def read(self) -> tuple[Snapshot, Road]:
        """Return the vehicles within the range, the vehicle itself first, and the road there."""
        vehicle = self._sumo.vehicle
        lane = vehicle.getLaneID(self._name)
        if _edge_of(lane) != self._edge:
            self._edge = _edge_of(lane)
            self._strips, self._ends_m = self._strips_around(self._edge)
        here_m = self._strips[lane].begin_m + vehicle.getLanePosition(self._name)
        names = (self._name, *(n for n in self._names(here_m) if n != self._name))
        columns = np.array([self._state(name) for name in names]).T.copy()
        return Snapshot(self._sumo.simulation.getTime(), names, *columns), self._road()

    def take_control(self, ego: EgoConfig) -> None:
        """Make SUMO execute our commands for the vehicle, and expect the braking of ``ego``."""
        vehicle, name = self._sumo.vehicle, self._name
        take_control(vehicle, name)
        vehicle.setParameter(name, "laneChangeModel.lcAccelLat", "1000")
        vehicle.setAccel(name, ego.accelerate_m_s2)
        vehicle.setDecel(name, ego.hard_brake_m_s2)
        vehicle.setEmergencyDecel(name, ego.hard_brake_m_s2)
        vehicle.setTau(name, EGO_TAU_S)

    def command(self, speed_m_s: float, aside_m: float) -> None:
        """Set the vehicle's speed, and its way to the left, for the next SUMO step."""
        self._sumo.vehicle.setSpeed(self._name, speed_m_s)
        if aside_m:
            self._sumo.vehicle.changeSublane(self._name, aside_m)

    def vehicle_types(self, ego: EgoConfig) -> VehicleTypes:
        """Return the limits of SUMO's vehicle types, and of the vehicle after ``take_control``.

        SUMO does not tell which models drive its types: they are taken for those of our scenarios.
        """
        kinds, vehicle, name = self._sumo.vehicletype, self._sumo.vehicle, self._name
        traffic_id = vehicle.getTypeID(name)
        found = {
            kind: VehicleType(
                kinds.getLength(kind),
                kinds.getWidth(kind),
                kinds.getAccel(kind),
                kinds.getDecel(kind),
                kinds.getEmergencyDecel(kind),
                kinds.getMaxSpeedLat(kind),
                AS_WRITTEN.traffic.model,
            )
            for kind in kinds.getIDList()
            if not kind.startswith("DEFAULT_") or kind == traffic_id
        }
        traffic = found.pop(traffic_id)
        size = {"length_m": vehicle.getLength(name), "width_m": vehicle.getWidth(name)}
        own = replace(
            AS_WRITTEN.ego,
            acceleration_m_s2=ego.accelerate_m_s2,
            braking_m_s2=ego.hard_brake_m_s2,
            emergency_braking_m_s2=ego.hard_brake_m_s2,
            **size,
        )
        return VehicleTypes(traffic, own, found, traffic_id)

    def lane_that_gives_way(self) -> str:
        """Return the first lane of the route that gives way or has a light; "" if none does."""
        route = self._sumo.vehicle.getRoute(self._name)
        for edge, following in pairwise(route):
            for lane in self._lanes_of(edge):
                for approached, _, _, _, _, state, *_ in self._sumo.lane.getLinks(lane):
                    if _edge_of(approached) == following and state != "M":
                        return lane
        return ""

    def _lane_width_m(self) -> float:
        vehicle, lane = self._sumo.vehicle, self._sumo.lane
        route = vehicle.getRoute(self._name)
        widths_m = {name: lane.getWidth(name) for edge in route for name in self._lanes_of(edge)}
        first_m = widths_m[next(iter(widths_m))]
        for name, width_m in widths_m.items():
            if abs(width_m - first_m) > SAME_WIDTH_M:
                raise SimulationError(
                    f"The lane {name!r} on the route of {self._name!r} is {width_m:g} m wide, but "
                    f"others are {first_m:g} m: give all lanes of the route one width."
                )
        return float(first_m)

    def _lanes_of(self, edge: str) -> list[str]:
        """Return the lanes of an edge that the vehicle's class may use, rightmost first."""
        lane, kind = self._sumo.lane, self._sumo.vehicle.getVehicleClass(self._name)
        names = [f"{edge}_{index}" for index in range(self._sumo.edge.getLaneNumber(edge))]
        return [
            name
            for name in names
            if kind not in lane.getDisallowed(name)
            and (not (allowed := lane.getAllowed(name)) or kind in allowed)
        ]

    def _strips_around(self, edge: str) -> tuple[dict[str, Strip], dict[int, float]]:
        """Return the strips near an edge by lane, and by index where a strip ends, metres."""
        strips = {
            f"{edge}_{index}": Strip(index, ORIGIN_M)
            for index in range(self._sumo.edge.getLaneNumber(edge))
        }
        ends_m: dict[int, float] = {}
        self._follow_back(strips, [*strips])
        self._follow_route(strips, ends_m, edge)
        lowest = min(strip.lane for strip in strips.values())
        moved = {name: Strip(one.lane - lowest, one.begin_m) for name, one in strips.items()}
        open_lanes = self._lanes_of(edge)
        self._closed = {
            one.lane
            for name, one in moved.items()
            if _edge_of(name) == edge and name not in open_lanes
        }
        return moved, {index - lowest: end_m for index, end_m in ends_m.items()}

    def _follow_back(self, strips: dict[str, Strip], lanes: Sequence[str]) -> None:
        """Add the strips that lead to these lanes, as far back as the range."""
        left = list(lanes)
        while left:
            lane = left.pop()
            index, begin_m = strips[lane]
            for before in self._before.get(lane, ()):
                if before not in strips and begin_m > ORIGIN_M - self._range_m:
                    strips[before] = Strip(index, begin_m - self._length_m[before])
                    left.append(before)

    def _follow_route(self, strips: dict[str, Strip], ends_m: dict[int, float], edge: str) -> None:
        """Add the strips ahead along the route, as far as an edge and the range reach."""
        route = list(self._sumo.vehicle.getRoute(self._name))
        ahead = route[self._sumo.vehicle.getRouteIndex(self._name) + 1 :]
        lanes = [name for name in strips if _edge_of(name) == edge]
        last_m = ORIGIN_M + self._length_m[lanes[0]] + self._range_m
        for following in ahead:
            names, arrived = self._lanes_of(following), dict[str, Strip]()
            for lane in lanes:
                if not self._lead_on(strips, lane, names, arrived):
                    index, begin_m = strips[lane]
                    ends_m[index] = begin_m + self._length_m[lane]
            if not arrived:
                return
            for name in names:
                strips[name] = arrived[name] = _beside(name, arrived)
            lanes = names
            if arrived[names[0]].begin_m > last_m:
                return

    def _lead_on(
        self, strips: dict[str, Strip], lane: str, names: Sequence[str], arrived: dict[str, Strip]
    ) -> bool:
        """Follow a lane over the junction to one of the lanes ``names``; False if it leads to none.

        The lanes inside the junction become strips, the lane behind it an entry of ``arrived``.
        """
        index, begin_m = strips[lane]
        leads_on = False
        for approached, via in self._after.get(lane, ()):
            if approached in names:
                at_m, inside = begin_m + self._length_m[lane], via
                while inside != approached:
                    strips[inside] = Strip(index, at_m)
                    at_m += self._length_m[inside]
                    inside = self._after[inside][0][1]
                arrived.setdefault(approached, Strip(index, at_m))
                leads_on = True
        return leads_on

    def _names(self, here_m: float) -> Iterator[str]:
        """Yield the vehicles on the strips within the range of the position ``here_m``."""
        on_lane = self._sumo.lane.getLastStepVehicleIDs
        for lane, (_, begin_m) in self._strips.items():
            nearest_m = min(max(here_m, begin_m), begin_m + self._length_m[lane])
            if abs(nearest_m - here_m) <= self._range_m:
                yield from on_lane(lane)

    def _state(self, name: str) -> tuple[float, ...]:
        lane, at, aside, speed, lateral, length, width = (read(name) for read in self._getters)
        index, begin_m = self._strips[lane]
        y_m = index * self.lane_width_m + aside
        return begin_m + at - length / 2, y_m, speed, lateral, length, width

    def _road(self) -> Road:
        """Return the lanes near the vehicle; one that ends or begins there is a partial lane.

        Vehicles can change to it or from it only on the edges of the route.
        """
        route = {self._edge, *self._sumo.vehicle.getRoute(self._name)}
        begins_m: dict[int, float] = {}
        joined_m: dict[int, float] = {}
        for lane, (index, begin_m) in self._strips.items():
            begins_m[index] = min(begin_m, begins_m.get(index, math.inf))
            if _edge_of(lane) in route:
                joined_m[index] = min(begin_m, joined_m.get(index, math.inf))
        parts = []
        for index, begin_m in sorted(begins_m.items()):
            end_m, from_m = self._ends_m.get(index, math.inf), joined_m[index]
            if end_m < math.inf or from_m > ORIGIN_M or begin_m < from_m:
                parts.append(PartialLane(index, begin_m, end_m, from_m, end_m))
        lanes = tuple(index not in self._closed for index in range(max(begins_m) + 1))
        limits = self._speed_limits(len(lanes))
        return Road(
            OPEN_LAP_M, self.lane_width_m, lanes, OPEN_LAP_M, tuple(parts), speed_limits=limits
        )

    def _speed_limits(self, lanes: int) -> tuple[tuple[SpeedLimit, ...], ...]:
        """Return what SUMO allows the vehicle on each strip, by lane and in driving order."""
        factor = float(self._sumo.vehicle.getSpeedFactor(self._name))
        found = [list[SpeedLimit]() for _ in range(lanes)]
        for name, (index, begin_m) in self._strips.items():
            allowed_m_s = factor * float(self._sumo.lane.getMaxSpeed(name))
            found[index].append(SpeedLimit(begin_m, begin_m + self._length_m[name], allowed_m_s))
        return tuple(tuple(sorted(limits)) for limits in found)


def _edge_of(lane: str) -> str:
    return lane.rpartition("_")[0]


def _beside(name: str, arrived: dict[str, Strip]) -> Strip:
    """Return the strip of a lane, from that of the nearest lane of its edge that has one."""
    if name in arrived:
        return arrived[name]
    at = int(name.rpartition("_")[2])
    nearest = min(arrived, key=lambda other: abs(int(other.rpartition("_")[2]) - at))
    index, begin_m = arrived[nearest]
    return Strip(index + at - int(nearest.rpartition("_")[2]), begin_m)
