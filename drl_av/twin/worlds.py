"""The state of many worlds as arrays: one row a world, one column a vehicle, column 0 the ego."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

NONE = -1


class Worlds(NamedTuple):
    """Worlds on one loop; arrays have shape (worlds, vehicles) if nothing else is said.

    A world has ``count`` vehicles, the ego included; the columns beyond are unused. Positions are
    those of the front bumper; ``aside_m`` is the offset of a body's centre from the centre of its
    lane, left positive. Everything that SUMO's models remember between two steps is here, so a
    copy of the arrays continues like the original.
    """

    count: IntArray
    """Vehicles of each world, shape (worlds,)."""
    step: IntArray
    """SUMO steps since the start, shape (worlds,)."""
    front_m: FloatArray
    speed_m_s: FloatArray
    acceleration_now_m_s2: FloatArray
    """Change of the speed in the last step, divided by its length."""
    lane: IntArray
    aside_m: FloatArray
    lateral_speed_m_s: FloatArray
    shadow: IntArray
    """The second lane that the body overlaps, or -1."""
    reserved: IntArray
    """The lane that the vehicle is about to enter, in which others make room for it, or -1."""
    length_m: FloatArray
    width_m: FloatArray
    desired_m_s: FloatArray
    headway_s: FloatArray
    acceleration_m_s2: FloatArray
    threshold_left: FloatArray
    """Speed gain from which SL2015 changes to the left."""
    threshold_right: FloatArray
    on_request_only: IntArray
    """1 if SUMO changes the vehicle's lane on request only, else 0."""
    request_lane: IntArray
    """Lane of the request that stands, or -1."""
    request_end: IntArray
    """The last step at which the request stands."""
    wanted_speed_m_s: FloatArray
    """Upper bound of the next speed by a command, or inf."""
    state: IntArray
    """SL2015's own state, flags of ``lane_changing``."""
    previous_state: IntArray
    maneuver_m: FloatArray
    """Lateral distance left of the lane change in progress."""
    commanded_m: FloatArray
    """Lateral distance left of a requested lane change that has begun, 0 if none."""
    is_full: IntArray
    """1 if SL2015 could make the whole lateral move in one step."""
    gain_left: FloatArray
    gain_right: FloatArray
    expected_m_s: FloatArray
    """Expected speeds in the lanes, shape (worlds, vehicles, lanes)."""
    advice_m_s: FloatArray
    """Speed that lane changes advise for the next step, or inf."""
    order: IntArray
    """The vehicles of each world by front position, the foremost first."""
    active: IntArray
    """SUMO's list of the strips of edges that have vehicles, shape (worlds, 4 * lanes)."""
    active_count: IntArray
    """Length of that list, shape (worlds,)."""
    marks: IntArray
    """Scratch: marks of the strips, shape (worlds, 4 * lanes)."""
    notes: FloatArray
    """Scratch numbers of the lane change being considered, shape (worlds, 16)."""
    near: IntArray
    """Scratch indices of vehicles, shape (worlds, 16)."""
    next_m_s: FloatArray
    """Scratch: the speeds after the step."""


class Loop(NamedTuple):
    """The road of all worlds, and what SUMO's steps depend on besides the vehicles."""

    lap_m: float
    edge_m: float
    """Length of a SUMO edge; drivers see to the end of an edge."""
    lane_m: float
    lanes: int
    first_open: int
    """The rightmost open lane."""
    last_open: int
    limit_m_s: float
    """SUMO's speed limit of the road."""
    overtake_right: bool
    """Whether a vehicle may be passed on the right above 60 km/h."""
    keeps_stopping_distance: bool
    """Whether each vehicle stays slow enough to stop behind the one ahead."""


def empty_worlds(worlds: int, vehicles: int, lanes: int) -> Worlds:
    """Return the arrays of ``worlds`` worlds for up to ``vehicles`` vehicles, the ego included."""

    def floats(*more: int) -> FloatArray:
        return np.zeros((worlds, *more))

    def ints(*more: int) -> IntArray:
        return np.zeros((worlds, *more), dtype=np.int64)

    shapes: dict[str, tuple[int, ...]] = {
        "count": (),
        "step": (),
        "active": (4 * lanes,),
        "active_count": (),
        "marks": (4 * lanes,),
        "expected_m_s": (vehicles, lanes),
        "notes": (16,),
        "near": (16,),
    }
    arrays = {
        name: (ints if kind is IntArray else floats)(*shapes.get(name, (vehicles,)))
        for name, kind in Worlds.__annotations__.items()
    }
    return Worlds(**arrays)
