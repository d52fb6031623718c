"""The road and the vehicles around one vehicle of any SUMO simulation, as ours describe them."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise, zip_longest
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from drl_av.config import EgoConfig
from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.errors import SimulationError
from drl_av.road.road import (
    LANE_CHANGE_DUE_M,
    OPEN_LAP_M,
    ForbiddenLine,
    PartialLane,
    Road,
    SpeedLimit,
)
from drl_av.road.snapshot import Snapshot
from drl_av.road.vehicle_types import LENGTHS_M, VehicleTypes
from drl_av.simulation.vehicle_calls import getters, take_control, types_in_use

ORIGIN_M = OPEN_LAP_M / 2
"""Position along our road at which the vehicle's present edge begins."""
SAME_WIDTH_M = 0.01
"""Lanes whose widths differ by less have the same width."""
STATE = (
    *("getLaneID", "getLanePosition", "getLateralLanePosition", "getSpeed", "getLateralSpeed"),
    *("getLength", "getWidth"),
)
EGO_TAU_S = 1.5
"""SUMO's tau of an ego: with it, and a minGap of ``STANDSTILL_GAP_M`` or more, others leave it the
room for one decision in which it accelerates."""


class Strip(NamedTuple):
    """A lane of SUMO as a part of our road: the index of its lane, and where it begins."""

    lane: int
    begin_m: float
    left_m: float = math.inf
    """A vehicle on it counts until its rear has left this position."""


Strips: TypeAlias = dict[str, list[Strip]]
"""The strips of each lane of SUMO; on a ring a lane is ahead and behind."""


class Surroundings:
    """Reads the surroundings of the vehicle ``name`` along its route; ours, for ``attach``.

    ``sumo`` is the module libsumo or traci, or a traci connection. A lane goes on in the lane to
    which SUMO connects it, and ends where it does not lead on along the route, or where it gives
    way to another lane that leads to the same one. A lane that is closed to the vehicle's class
    does not exist. On a ring each other vehicle is ahead and behind.

    Raises:
        SimulationError: SUMO has no such vehicle on the road, or the lanes of its route differ in
            width.
    """

    def __init__(self, sumo: Any, name: str, range_m: float) -> None:
        self._sumo, self.name, self._range_m = sumo, name, range_m
        if not self.is_on_the_road:
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
        self._strips: Strips = {}
        self._beside: Strips = {}
        """Lanes that are no part of our road, from which bodies reach into it."""
        self._ends_m: dict[int, list[float]] = {}
        """Where the lanes of each index end; another one with this index may begin behind it."""
        self._closed: set[int] = set()
        self.route: Sequence[str] = ()
        """The edges of the vehicle's route when it was read last."""
        self.lane_width_m = math.nan
        """The width of each lane of the route, metres."""
        self._read_route()

    @property
    def is_on_the_road(self) -> bool:
        """Whether SUMO drives the vehicle: it has not arrived, is not removed and does not park."""
        vehicle = self._sumo.vehicle
        return self.name in vehicle.getIDList() and bool(vehicle.getLaneID(self.name))

    def read(self) -> tuple[Snapshot, Road]:
        """Return the vehicles within the range, the vehicle itself first, and the road there."""
        vehicle = self._sumo.vehicle
        if vehicle.getRoute(self.name) != self.route:
            self._read_route()
        self._edge = _edge_of(vehicle.getLaneID(self.name))
        self._find_strips()
        here_m = ORIGIN_M + vehicle.getLanePosition(self.name)
        states = dict[str, tuple[float, ...]]()
        for name in dict.fromkeys((self.name, *self._names(here_m))):
            for number, state in enumerate(self._states(name, here_m)):
                states[f"{name}, {number}" if number else name] = state
        columns = np.array([*states.values()]).T.copy()
        return Snapshot(self._sumo.simulation.getTime(), (*states,), *columns), self._road()

    @property
    def is_teleported(self) -> bool:
        """Whether SUMO took the vehicle from its place in the last step, to put it elsewhere."""
        return self.name in self._sumo.simulation.getStartingTeleportIDList()

    @property
    def _way(self) -> Sequence[str]:
        """The edges of the route from the present one on, or from the next one in a junction."""
        has_left = self._sumo.vehicle.getLaneID(self.name)[:1] == ":"
        return self.route[max(self._sumo.vehicle.getRouteIndex(self.name), 0) + has_left :]

    def _read_route(self) -> None:
        self.route = self._sumo.vehicle.getRoute(self.name)
        self.lane_width_m = self._lane_width_m()

    def take_control(self, ego: EgoConfig) -> None:
        """Make SUMO execute our commands for the vehicle, and expect the braking of ``ego``."""
        vehicle, name = self._sumo.vehicle, self.name
        take_control(vehicle, name)
        vehicle.setActionStepLength(name, self._sumo.simulation.getDeltaT())
        vehicle.setAccel(name, ego.accelerate_m_s2)
        vehicle.setDecel(name, ego.hard_brake_m_s2)
        vehicle.setEmergencyDecel(name, ego.hard_brake_m_s2)
        vehicle.setTau(name, EGO_TAU_S)
        vehicle.setMinGap(name, max(vehicle.getMinGap(name), STANDSTILL_GAP_M))

    def command(self, speed_m_s: float, aside_m: float) -> None:
        """Set the vehicle's speed, and its way to the left, for the next SUMO step."""
        self._sumo.vehicle.setSpeed(self.name, speed_m_s)
        if aside_m:
            self._sumo.vehicle.changeSublane(self.name, aside_m)

    def vehicle_types(self, ego: EgoConfig) -> VehicleTypes:
        """Return the limits of the vehicles, as ``types_in_use`` does."""
        return types_in_use(self._sumo, self.name, ego)

    def lane_that_gives_way(self) -> str:
        """Return the first lane of the route that gives way or has a light; "" if none does."""
        for edge, following in pairwise(self._way):
            for lane in self._lanes_of(edge):
                for approached, _, _, _, _, state, *_ in self._sumo.lane.getLinks(lane):
                    if _edge_of(approached) == following and state != "M":
                        return lane
        return ""

    def _lane_width_m(self) -> float:
        lane, edges = self._sumo.lane, dict.fromkeys(self._way)
        widths_m = {name: lane.getWidth(name) for edge in edges for name in self._lanes_of(edge)}
        first_m = widths_m[next(iter(widths_m))]
        for name, width_m in widths_m.items():
            if abs(width_m - first_m) > SAME_WIDTH_M:
                raise SimulationError(
                    f"The lane {name!r} on the route of {self.name!r} is {width_m:g} m wide, but "
                    f"others are {first_m:g} m: give all lanes of the route one width."
                )
        return float(first_m)

    def _lanes_of(self, edge: str) -> list[str]:
        """Return the lanes of an edge that the vehicle's class may use, rightmost first."""
        lane, kind = self._sumo.lane, self._sumo.vehicle.getVehicleClass(self.name)
        names = [f"{edge}_{index}" for index in range(self._sumo.edge.getLaneNumber(edge))]
        return [
            name
            for name in names
            if kind not in lane.getDisallowed(name)
            and (not (allowed := lane.getAllowed(name)) or kind in allowed)
        ]

    def _find_strips(self) -> None:
        """Find the strips around the present edge, and by index where a strip ends, metres."""
        lanes = [f"{self._edge}_{k}" for k in range(self._sumo.edge.getLaneNumber(self._edge))]
        self._strips = {lane: [Strip(index, ORIGIN_M)] for index, lane in enumerate(lanes)}
        self._beside, self._ends_m = {}, {}
        self._follow_route(lanes)
        self._follow_back(lanes)
        self._follow_merging()
        lowest = min(strip.lane for _, strip in self._pairs())
        for each in (self._strips, self._beside):
            for own in each.values():
                own[:] = [one._replace(lane=one.lane - lowest) for one in own]
        self._ends_m = {index - lowest: ends_m for index, ends_m in self._ends_m.items()}
        open_lanes = self._lanes_of(self._edge)
        self._closed = {self._strips[lane][0].lane for lane in lanes if lane not in open_lanes}

    def _follow_back(self, lanes: Sequence[str]) -> None:
        """Add the strips that lead to these lanes, as far back as the range."""
        left = [(lane, self._strips[lane][0]) for lane in lanes]
        found = set[tuple[str, int]]()
        while left:
            lane, (index, begin_m, _) = left.pop()
            for before in self._before.get(lane, ()):
                if (before, index) not in found and begin_m > ORIGIN_M - self._range_m:
                    found.add((before, index))
                    strip = Strip(index, begin_m - self._length_m[before])
                    self._strips.setdefault(before, []).append(strip)
                    left.append((before, strip))

    def _follow_merging(self) -> None:
        """Add the lanes inside junctions on which others enter a strip; they may have to yield."""
        left = [*self._pairs()]
        while left:
            lane, (index, begin_m, _) = left.pop()
            for before in self._before.get(lane, ()):
                known = self._beside.get(before, [])
                is_left = all(one.left_m < math.inf for one in known)
                if before[:1] == ":" and before not in self._strips and is_left:
                    inside = Strip(index, begin_m - self._length_m[before])
                    self._beside[before] = [*known, inside]
                    left.append((before, inside))

    def _follow_route(self, lanes: Sequence[str]) -> None:
        """Add the strips ahead along the route, as far as the range and its lane changes reach."""
        ahead = self.route[self._sumo.vehicle.getRouteIndex(self.name) + 1 :]
        sight_m = max(self._range_m, LANE_CHANGE_DUE_M * len(lanes))
        last_m = ORIGIN_M + self._length_m[lanes[0]] + sight_m
        here = {lane: self._strips[lane][0] for lane in lanes}
        wanted = {each for *_, way in self._sumo.vehicle.getBestLanes(self.name) for each in way}
        for following, next_edge in zip_longest(ahead, ahead[1:], fillvalue=""):
            names, arrived = self._lanes_of(following), dict[str, Strip]()
            # of several lanes to which one leads, the one that SUMO drives carries its number
            best = [name for name in names if name in wanted]
            best = best or [name for name in names if self._leads_to(name, next_edge)] or names
            # of two lanes that lead to one, the one that need not give way goes on
            for lane in sorted(here, key=lambda lane: not self._is_major(lane, names)):
                if not self._lead_on(lane, here[lane], names, best, arrived):
                    end_m = here[lane].begin_m + self._length_m[lane]
                    self._ends_m.setdefault(here[lane].lane, []).append(end_m)
            if not arrived:
                return
            here = {name: _beside(name, arrived) for name in names}
            for name, strip in here.items():
                self._strips.setdefault(name, []).append(strip)
            if here[names[0]].begin_m > last_m:
                return

    def _leads_to(self, lane: str, edge: str) -> bool:
        return any(_edge_of(approached) == edge for approached, _ in self._after.get(lane, ()))

    def _is_major(self, lane: str, names: Sequence[str]) -> bool:
        links = self._sumo.lane.getLinks(lane)
        return any(approached in names and state == "M" for approached, *_, state, _, _ in links)

    def _lead_on(
        self, lane: str, strip: Strip, names: list[str], best: list[str], arrived: dict[str, Strip]
    ) -> bool:
        """Follow a lane over the junction to one of the lanes ``names``; False if it leads to none.

        If it leads to several, it goes on in one of ``best``. The lanes inside the junction become
        strips, the lane behind it an entry of ``arrived``. The other lanes to which it leads are
        beside our road: of those that leave it, the bodies that reach back count, and one that
        merges is a part of the lane to which it leads.
        """
        end_m = strip.begin_m + self._length_m[lane]
        after = self._after.get(lane, ())
        free = [each for each, _ in after if each in names and each not in arrived]
        main = next((each for each in free if each in best), free[0] if free else None)
        for approached, via in after:
            merges, goes_on = approached in arrived, approached == main
            left_m = math.inf if goes_on or merges else end_m
            index = arrived[approached].lane if merges else strip.lane
            own, at_m, inside = self._strips if goes_on else self._beside, end_m, via
            while inside != approached:
                own.setdefault(inside, []).append(Strip(index, at_m, left_m))
                at_m += self._length_m[inside]
                inside = self._after[inside][0][1]
            if goes_on:
                at_main_m = at_m
            if not goes_on and not merges and approached not in names:
                self._follow_aside(approached, Strip(index, at_m, left_m))
        if main is not None:
            arrived[main] = Strip(strip.lane, at_main_m)
        return main is not None

    def _follow_aside(self, lane: str, strip: Strip) -> None:
        """Add the lanes from which a body can reach back to the end of the one that it has left."""
        while strip.begin_m < strip.left_m + LENGTHS_M[1]:
            self._beside.setdefault(lane, []).append(strip)
            strip = strip._replace(begin_m=strip.begin_m + self._length_m[lane])
            if not (after := self._after.get(lane)):
                return
            lane = after[0][1]

    def _names(self, here_m: float) -> Iterator[str]:
        """Yield the vehicles on the lanes that are within the range of the position ``here_m``."""
        for lane, own in (*self._strips.items(), *self._beside.items()):
            reach_m = self._length_m[lane] + self._range_m
            if any(-self._range_m <= here_m - one.begin_m <= reach_m for one in own):
                yield from self._sumo.lane.getLastStepVehicleIDs(lane)

    def _states(self, name: str, here_m: float) -> Iterator[tuple[float, ...]]:
        """Yield a vehicle's columns of the snapshot: where it is nearest, and elsewhere in range.

        It is in each lane to which its own lane leads; on a ring it is ahead and behind.
        """
        lane, at, aside, speed, lateral, length, width = (read(name) for read in self._getters)
        own = [*self._strips.get(lane, ()), *self._beside.get(lane, ())]
        own.sort(key=lambda strip: abs(strip.begin_m + at - here_m))
        places = dict[tuple[int, float], None]()
        for index, from_m, left_m in own[: 1 if name == self.name else None]:
            begin_m = next((m for _, m in places if abs(from_m - m) < LENGTHS_M[1]), from_m)
            is_near = not places or abs(begin_m + at - here_m) <= self._range_m
            if is_near and begin_m + at - length < left_m:
                places[index, begin_m] = None
        for index, begin_m in places:
            y_m = index * self.lane_width_m + aside
            yield begin_m + at - length / 2, y_m, speed, lateral, length, width

    def _road(self) -> Road:
        """Return the lanes near the vehicle; one that ends or begins there is a partial lane.

        Vehicles can change to it or from it only on the edges of the route.
        """
        route, parts = {self._edge, *self.route}, []
        begins_m, joined_m = dict[int, list[float]](), dict[int, list[float]]()
        for lane, (index, begin_m, _) in self._pairs():
            begins_m.setdefault(index, []).append(begin_m)
            if _edge_of(lane) in route:
                joined_m.setdefault(index, []).append(begin_m)
        for index, begins in sorted(begins_m.items()):
            for low, high in pairwise([-math.inf, *sorted(self._ends_m.get(index, ())), math.inf]):
                begin_m = min((m for m in begins if low - 1e-6 <= m < high - 1e-6), default=high)
                own = [m for m in joined_m[index] if low - 1e-6 <= m < high - 1e-6]
                from_m = min(own, default=high)
                if begin_m < high and (high < math.inf or from_m > ORIGIN_M or begin_m < from_m):
                    parts.append(PartialLane(index, begin_m, high, from_m, high))
        open_lanes = begins_m.keys() - self._closed
        lanes = tuple(index in open_lanes for index in range(max(begins_m) + 1))
        lines, limits = tuple(self._forbidden_lines()), self._speed_limits(len(lanes))
        ground = OPEN_LAP_M, self.lane_width_m, lanes, OPEN_LAP_M, tuple(parts)
        return Road(*ground, forbidden_lines=lines, speed_limits=limits)

    def _pairs(self) -> Iterator[tuple[str, Strip]]:
        """Yield each lane of SUMO with each of its strips."""
        return ((lane, strip) for lane, own in self._strips.items() for strip in own)

    def _forbidden_lines(self) -> Iterator[ForbiddenLine]:
        """Yield the lines between two lanes of an edge that the vehicle's class may not cross."""
        kind = self._sumo.vehicle.getVehicleClass(self.name)
        for lane, (index, begin_m, _) in self._pairs():
            edge, _, number = lane.rpartition("_")
            for side in (1, -1):
                if f"{edge}_{int(number) + side}" in self._strips:
                    permitted = self._sumo.lane.getChangePermissions(lane, side)
                    if kind not in permitted and "all" not in permitted:
                        yield ForbiddenLine(index, side, begin_m, begin_m + self._length_m[lane])

    def _speed_limits(self, lanes: int) -> tuple[tuple[SpeedLimit, ...], ...]:
        """Return what SUMO allows the vehicle on each strip, by lane and in driving order.

        SUMO tells the limit of its class on the present lane only.
        """
        vehicle, name = self._sumo.vehicle, self.name
        factor, fastest = float(vehicle.getSpeedFactor(name)), float(vehicle.getMaxSpeed(name))
        here_m_s = factor * float(self._sumo.lane.getMaxSpeed(vehicle.getLaneID(name)))
        of_class_m_s = float(vehicle.getAllowedSpeed(name))
        is_lower = of_class_m_s < min(here_m_s, fastest) - 1e-6
        found = [list[SpeedLimit]() for _ in range(lanes)]
        for lane, (index, begin_m, _) in self._pairs():
            allowed_m_s = min(factor * float(self._sumo.lane.getMaxSpeed(lane)), fastest)
            if is_lower and _edge_of(lane) == self._edge:
                allowed_m_s = min(allowed_m_s, of_class_m_s)
            found[index].append(SpeedLimit(begin_m, begin_m + self._length_m[lane], allowed_m_s))
        return tuple(tuple(sorted(limits)) for limits in found)


def _edge_of(lane: str) -> str:
    return lane.rpartition("_")[0]


def _beside(name: str, arrived: dict[str, Strip]) -> Strip:
    """Return the strip of a lane, from that of the nearest lane of its edge that has one."""
    if name in arrived:
        return arrived[name]
    at = int(name.rpartition("_")[2])
    nearest = min(arrived, key=lambda other: abs(int(other.rpartition("_")[2]) - at))
    strip = arrived[nearest]
    return strip._replace(lane=strip.lane + at - int(nearest.rpartition("_")[2]))
