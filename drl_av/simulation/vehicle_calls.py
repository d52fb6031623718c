"""Calls on the vehicles of SUMO: they are added, commanded, handed over, read and removed."""

import struct
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.compiled import compiled
from drl_av.config import EgoConfig, TrafficConfig
from drl_av.road.road import CENTERED_M, is_partial
from drl_av.road.snapshot import EGO_ID
from drl_av.road.vehicle_types import AS_WRITTEN, VehicleType, VehicleTypes
from drl_av.scenarios.folder import Scenario
from drl_av.scenarios.layout import Layout, route_on
from drl_av.simulation.population import Population

LANE_CHANGES_ON_REQUEST = 1536
"""SUMO's lane change mode: change lanes on request only, if the gaps are safe, and keep centred."""


def leave_to_commands(vehicle: Any, name: str) -> None:
    """Make SUMO change the lane of the vehicle ``name`` on request only.

    ``vehicle`` is the domain ``vehicle`` of libsumo or traci. The speed mode remains SUMO's
    default: a request never makes the vehicle faster than SUMO's IDM considers safe, and never
    exceeds the acceleration and braking of its type.
    """
    vehicle.setLaneChangeMode(name, LANE_CHANGES_ON_REQUEST)


def is_centered(vehicle: Any, name: str) -> bool:
    """Whether the vehicle ``name`` is so near its lane's centre that it may request a lane change.

    If the vehicle is away from the centre, another vehicle may have interrupted its lane change. A
    new request would make SUMO continue it, even into that other vehicle.
    """
    return bool(abs(vehicle.getLateralLanePosition(name)) <= CENTERED_M)


def packed(numbers: Sequence[float], rows: int) -> FloatArray:
    """Return numbers as an array with this number of rows, in half the time of np.array."""
    memory = bytearray(8 * len(numbers))
    struct.pack_into(f"{len(numbers)}d", memory, 0, *numbers)
    return np.frombuffer(memory).reshape(rows, -1)


ALL_SPEED_CHECKS_OFF = 32
NO_AUTONOMOUS_LANE_CHANGES = 0
SPEED_CHECKS = 31
AUTONOMOUS_LANE_CHANGES = 1621
"""Bit sets for SUMO's setSpeedMode and setLaneChangeMode; the last two are SUMO's defaults."""


class EgoModel(NamedTuple):
    """Parameters of SUMO's models IDM and SL2015 for the ego; the defaults are those of SUMO."""

    headway_s: float = 1.0
    """SUMO's tau, the time gap."""
    assertiveness: float = 1.0
    """SUMO's lcAssertive; it divides the gaps that a lane change needs."""
    speed_gain: float = 1.0
    """SUMO's lcSpeedGain, the eagerness to change lanes for speed."""
    overtake_right: bool = False
    """Whether the ego may pass on the right above 60 km/h."""


def take_control(vehicle: Any, name: str) -> None:
    """Make SUMO execute our commands for a vehicle exactly and take no actions of its own.

    ``vehicle`` is the domain ``vehicle`` of libsumo or traci; ``name`` is the vehicle's id.
    """
    vehicle.setSpeedMode(name, ALL_SPEED_CHECKS_OFF)
    vehicle.setLaneChangeMode(name, NO_AUTONOMOUS_LANE_CHANGES)
    vehicle.setMaxSpeedLat(name, 10.0)
    for limit in ("lcAccelLat", "lcMaxSpeedLatStanding"):
        vehicle.setParameter(name, f"laneChangeModel.{limit}", "1000")


def hand_over(vehicle: Any, model: EgoModel, ego: EgoConfig, lane_width_m: float) -> None:
    """Let SUMO drive the ego from now on, within the speed and acceleration limits of ``ego``.

    SL2015 permits only emergency vehicles to pass on the right above 60 km/h. If
    ``model.overtake_right`` is true, the ego therefore becomes an emergency vehicle without a
    siren, for which other vehicles do not make way. The ego keeps its size. ``vehicle`` is the
    domain ``vehicle`` of libsumo or traci.
    """
    color, length_m, width_m = (
        read(EGO_ID) for read in (vehicle.getColor, vehicle.getLength, vehicle.getWidth)
    )
    vehicle.setType(EGO_ID, "traffic")
    standing_m_s = vehicle.getMaxSpeedLat(EGO_ID)
    vehicle.setColor(EGO_ID, color)
    vehicle.setLength(EGO_ID, length_m)
    vehicle.setWidth(EGO_ID, width_m)
    vehicle.setSpeedMode(EGO_ID, SPEED_CHECKS)
    vehicle.setLaneChangeMode(EGO_ID, AUTONOMOUS_LANE_CHANGES)
    vehicle.setMaxSpeed(EGO_ID, ego.max_speed_m_s)
    vehicle.setAccel(EGO_ID, ego.accelerate_m_s2)
    vehicle.setDecel(EGO_ID, ego.hard_brake_m_s2)
    vehicle.setEmergencyDecel(EGO_ID, ego.hard_brake_m_s2)
    vehicle.setMaxSpeedLat(EGO_ID, lane_width_m / ego.lane_change_duration_s)
    vehicle.setTau(EGO_ID, model.headway_s)
    of_model = {"lcAssertive": model.assertiveness, "lcSpeedGain": model.speed_gain}
    for name, value in {**of_model, "lcMaxSpeedLatStanding": standing_m_s}.items():
        vehicle.setParameter(EGO_ID, f"laneChangeModel.{name}", repr(value))
    if model.overtake_right:
        vehicle.setVehicleClass(EGO_ID, "emergency")


def spawn(
    vehicle: Any,
    population: Population,
    row: int,
    type_id: str,
    layout: Layout,
    traffic: TrafficConfig,
) -> None:
    """Add the vehicle in this row of a population to SUMO at its position, with its parameters.

    ``vehicle`` is the domain ``vehicle`` of libsumo or traci.
    """
    name, speed = population.ids[row], float(population.speed_m_s[row])
    lane_id, position_m = _lane_and_position(layout, population.lane[row], population.front_m[row])
    is_way = name == EGO_ID or is_partial(int(population.lane[row]), layout.road)
    route = route_on(layout.routes, lane_id.rpartition("_")[0], is_way)
    vehicle.add(name, route, type_id, "now", departSpeed="0")
    if population.is_truck[row]:
        vehicle.setLength(name, traffic.truck_length_m)
        vehicle.setWidth(name, traffic.truck_width_m)
        vehicle.setShapeClass(name, "truck")
    vehicle.moveTo(name, lane_id, position_m)
    vehicle.setPreviousSpeed(name, speed)
    if name == EGO_ID:
        take_control(vehicle, name)
    else:
        vehicle.setTau(name, float(population.headway_s[row]))
        vehicle.setAccel(name, float(population.acceleration_m_s2[row]))
        gain = repr(float(population.speed_gain[row]))
        vehicle.setParameter(name, "laneChangeModel.lcSpeedGain", gain)
    vehicle.setMaxSpeed(name, float(population.desired_speed_m_s[row]))


def clear_the_road(sumo: ModuleType) -> None:
    """Remove all vehicles, so that SUMO continues as if there had never been any.

    ``sumo`` is the module libsumo or traci. The function makes two SUMO steps. In the first one
    SUMO ends all lane changes: SUMO sometimes keeps the space for the lane change of a vehicle that
    is removed, and later vehicles would brake behind this space. The second one frees the names.
    """
    for name in sumo.vehicle.getLoadedIDList():
        sumo.vehicle.setLaneChangeMode(name, NO_AUTONOMOUS_LANE_CHANGES)
    sumo.simulationStep()
    for name in sumo.vehicle.getLoadedIDList():
        sumo.vehicle.remove(name)
    sumo.simulationStep()


def _lane_and_position(layout: Layout, lane: int, front_m: float) -> tuple[str, float]:
    """Return the SUMO lane id of a position on the road, and the position on that lane, metres."""
    best = max(
        (start_m, lane_id)
        for lane_id, (index, start_m) in layout.lane_positions.items()
        if index == lane and start_m <= front_m
    )
    return best[1], float(front_m - best[0])


STATE = (
    *("getLaneID", "getLanePosition", "getLateralLanePosition", "getSpeed", "getLateralSpeed"),
    "getLaneChangeState",
)


class StateReader:
    """Reads the state of the vehicles on the road; ``watch`` sets their names."""

    _ids: Sequence[str]
    _half_m: FloatArray

    def __init__(self, sumo: ModuleType, scenario: Scenario) -> None:
        self._lane_positions = scenario.layout.lane_positions
        self._lap_m, self._lane_m = float(scenario.road.lap_m), float(scenario.road.lane_width_m)
        self._row_of = {name: row for row, name in enumerate(self._lane_positions)}
        self._lanes = np.array([*self._lane_positions.values()], dtype=np.float64)
        self._lane, self._at, self._aside, self._speed, *others = getters(sumo, STATE)
        self._lateral_speed, self._lane_change = others
        bits = sumo.constants
        self._wanted = (1, bits.LCA_LEFT), (-1, bits.LCA_RIGHT)
        self._blocked: int = bits.LCA_BLOCKED

    def watch(self, ids: Sequence[str], length_m: FloatArray) -> None:
        """Set the vehicles on the road; a row is an index into ``ids``, the ego's is 0."""
        self._ids, self._half_m = ids, length_m / 2

    def position(self, row: int) -> tuple[float, float]:
        """Return the position of a vehicle's centre along (s) and across (y) the road, metres."""
        name = self._ids[row]
        lane, start_m = self._lane_positions[self._lane(name)]
        along_m = (start_m + self._at(name) - float(self._half_m[row])) % self._lap_m
        return along_m, lane * self._lane_m + self._aside(name)

    def state(self, first: int = 0) -> FloatArray:
        """Return s, y (m), speed and lateral speed (m/s) of the rows from ``first`` on.

        The shape is (4, rows).
        """
        ids = self._ids[first:]
        read = (
            *map(self._row_of.__getitem__, map(self._lane, ids)),
            *map(self._at, ids),
            *map(self._aside, ids),
            *map(self._speed, ids),
            *map(self._lateral_speed, ids),
        )
        columns = packed(read, 5)
        place.fast(columns, self._lanes, self._half_m[first:], self._lap_m, self._lane_m)
        return columns[1:]

    def lane_change(self, row: int) -> int:
        """Return the lane change that SUMO's model would make now: +1 left, -1 right, 0 none."""
        for sign, wanted in self._wanted:
            state = self._lane_change(self._ids[row], sign)[0]
            if state & wanted and not state & self._blocked:
                return sign
        return 0


@compiled
def place(
    columns: FloatArray, lanes: FloatArray, half_m: FloatArray, lap_m: float, lane_m: float
) -> None:
    """Convert positions on SUMO's lanes to positions along and across the road, in place.

    ``columns``, shape (5, rows), holds an index into ``lanes``, the position of the front bumper on
    the lane, and the lateral position on it; the second and third become s and y, metres.
    ``lanes``, shape (lanes, 2), holds the index of each lane across the road, and its start.
    """
    for row in range(columns.shape[1]):
        lane = int(columns[0, row])
        columns[1, row] = (lanes[lane, 1] + columns[1, row] - half_m[row]) % lap_m
        columns[2, row] = lanes[lane, 0] * lane_m + columns[2, row]


def getters(sumo: ModuleType, names: Sequence[str]) -> list[Callable[..., Any]]:
    """Return the function ``sumo.vehicle.<name>`` for each name.

    For libsumo these are the C functions themselves: SWIG's Python wrapper around each of them
    takes a quarter to a third of the time of a call.
    """
    within = getattr(sumo, "_libsumo", None)
    return [getattr(within, f"vehicle_{name}", getattr(sumo.vehicle, name)) for name in names]


def types_in_use(sumo: Any, name: str, ego: EgoConfig) -> VehicleTypes:
    """Return the limits of SUMO's vehicle types, and of the vehicle ``name`` under our control.

    SUMO's default types count if a vehicle that it has loaded has them. Of their models SUMO tells
    only ``tau`` and how often they act: the rest is taken for ours. Another vehicle that we drive,
    whose type SUMO calls TYPE@NAME, has the limits of this one.
    """
    kinds, vehicle = sumo.vehicletype, sumo.vehicle
    traffic_id = vehicle.getTypeID(name).removesuffix(f"@{name}")
    ours, used = {f"{traffic_id}@{name}"}, {traffic_id}
    for each in vehicle.getLoadedIDList():
        used.add(kind := vehicle.getTypeID(each))
        if kind.endswith(f"@{each}") and vehicle.getSpeedMode(each) == ALL_SPEED_CHECKS_OFF:
            ours.add(kind)
    found = {
        kind: VehicleType(
            *(kinds.getLength(kind), kinds.getWidth(kind), kinds.getAccel(kind)),
            *(kinds.getDecel(kind), kinds.getEmergencyDecel(kind), kinds.getMaxSpeedLat(kind)),
            _model_of(sumo, kind),
        )
        for kind in kinds.getIDList()
        if kind not in ours and (not kind.startswith("DEFAULT_") or kind in used)
    }
    size_m, hard_m_s2 = (vehicle.getLength(name), vehicle.getWidth(name)), ego.hard_brake_m_s2
    limits = ego.accelerate_m_s2, hard_m_s2, hard_m_s2, AS_WRITTEN.ego.lateral_speed_m_s
    own = VehicleType(*size_m, *limits, AS_WRITTEN.ego.model)
    return VehicleTypes(found.pop(traffic_id), own, found, traffic_id)


def _model_of(sumo: Any, kind: str) -> tuple[tuple[str, str], ...]:
    """Return the model of a type: ours, its tau, and an actionStepLength above a SUMO step."""
    kinds, own = sumo.vehicletype, AS_WRITTEN.traffic.model
    acts_s, tau = float(kinds.getActionStepLength(kind)), f"{kinds.getTau(kind):g}"
    late = acts_s > sumo.simulation.getDeltaT() + 1e-6
    return *own, ("tau", tau), *((("actionStepLength", f"{acts_s:g}"),) if late else ())
