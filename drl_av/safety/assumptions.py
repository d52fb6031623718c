"""The assumptions that ``strict`` makes about the settings, the vehicle types and the road.

The safety of ``strict`` is proved in docs/safety.md. ``require_assumptions`` raises ConfigError for
a combination that breaks an assumption of the proof; the message names the setting.
"""

import math
from collections.abc import Collection
from dataclasses import asdict

import numpy as np

from drl_av.config import Config
from drl_av.errors import ConfigError
from drl_av.road.road import ARRIVED_M, Road
from drl_av.road.vehicle_types import AS_WRITTEN, VehicleType, VehicleTypes
from drl_av.safety.reachability import LINE_M, ON_LINE_M, cut_in_gap

ROAD_AS_WRITTEN = Road(500.0, 3.8, (True, True, True))
"""The road of a new scenario with the default sizes."""
AT_MOST = (
    ("traffic.acceleration_max_m_s2", "strict.acceleration_m_s2", "bound 4"),
    ("traffic.truck_acceleration_m_s2", "strict.acceleration_m_s2", "bound 4"),
    ("the accel of the vehicle type traffic", "strict.acceleration_m_s2", "bound 4"),
    ("the decel of the vehicle type traffic", "strict.braking_m_s2", "bound 1"),
    ("the emergencyDecel of the vehicle type traffic", "strict.braking_m_s2", "bound 1"),
    ("the maxSpeedLat of the vehicle type traffic", "strict.lateral_speed_m_s", "bound 2"),
    ("strict.follower_braking_m_s2", "the decel of the vehicle type traffic", "bound 4"),
    ("strict.follower_braking_m_s2", "ego.hard_brake_m_s2", "the lemma hand-over"),
    ("ego.hard_brake_m_s2", "strict.braking_m_s2", "the lemma following"),
    ("simulation.step_length_s", "strict.follower_response_s", "bound 4"),
    ("simulation.step_length_s", "the tau of the vehicle type traffic", "bound 4"),
    ("simulation.step_length_s", "traffic.headway_min_s", "bound 4"),
    ("ego.accelerate_m_s2", "the accel of the vehicle type ego", "bound 3"),
    ("the decel of the vehicle type ego", "ego.hard_brake_m_s2", "bound 3"),
)
"""(a, b, reason): a must be at most b; ``reason`` names what fails in the proof otherwise."""
PER_VEHICLE = ("maxSpeed", "tau", "lcSpeedGain")
"""Attributes that a type may state: they are set for each vehicle in any case."""
FALLBACK_CHECK = "the check paper (--safety-check paper)"
"""The check that needs no assumptions, as the error messages recommend it."""
ROUNDING_M = 1e-6
"""Largest rounding error of a lateral position or of a width, metres."""
LATERAL_GAP_M = 0.6
"""SUMO's minGapLat: the smallest lateral gap between two vehicles beside each other in a lane."""
RANDOM_LANE_CHANGES_PER_S = 0.01
"""The largest rate of random lane changes that ``strict`` allows; no kind of traffic has more."""
AT_LEAST = (
    ("follower_braking_m_s2", 0.5, "the lemma response is not proved for weaker braking"),
    ("clearance_m", 0.001, "the lemma rounding is not proved for less: bodies may touch"),
)
"""(name, least, reason): this setting of the section strict must be at least ``least``."""


def require_assumptions(config: Config, vehicle_types: VehicleTypes, road: Road) -> None:
    """Raise ConfigError if an assumption of ``strict`` does not hold for this combination."""
    for name, traffic in vehicle_types.others.items():
        met = VehicleTypes(traffic, vehicle_types.ego)
        _require_bounds(config, met, name)
        _require_model(name, traffic, AS_WRITTEN.traffic, PER_VEHICLE)
        _require_one_vehicle_abreast(config, met, road, name)
        _require_narrow_vehicles(config, met, road, name)
        _require_a_long_loop(config, met, road)
    _require_model("ego", vehicle_types.ego, AS_WRITTEN.ego)
    _require_a_decision_on_the_line(config, vehicle_types.ego, road)
    most, found = RANDOM_LANE_CHANGES_PER_S, config.traffic.random_lane_changes_per_s
    if found > most:
        raise _refusal(
            "traffic.random_lane_changes_per_s",
            f"at most {most:g}, and not {found:g}",
            "bound 3 fails: a vehicle that gets a second request in the middle of a lane change "
            "continues it even into a vehicle beside it",
        )
    for name, least, reason in AT_LEAST:
        if (found := getattr(config.strict, name)) < least:
            raise _refusal(f"strict.{name}", f"at least {least:g}, and not {found:g}", reason)


def _refusal(name: str, bound: str, reason: str) -> ConfigError:
    """Return the error that ``name`` breaks the bound ``bound``, with the reason for the bound."""
    return ConfigError(
        f"Under the check strict {name} must be {bound}, because {reason}: change it, or take "
        f"{FALLBACK_CHECK}."
    )


def _require_bounds(config: Config, vehicle_types: VehicleTypes, label: str) -> None:
    """Raise ConfigError if a value that ``AT_MOST`` lists exceeds its bound."""
    traffic, ego = vehicle_types.traffic, vehicle_types.ego
    facts = {
        "the accel of the vehicle type traffic": traffic.acceleration_m_s2,
        "the decel of the vehicle type traffic": traffic.braking_m_s2,
        "the emergencyDecel of the vehicle type traffic": traffic.emergency_braking_m_s2,
        "the maxSpeedLat of the vehicle type traffic": traffic.lateral_speed_m_s,
        "the tau of the vehicle type traffic": float(dict(traffic.model).get("tau", math.inf)),
        "the accel of the vehicle type ego": ego.acceleration_m_s2,
        "the decel of the vehicle type ego": ego.braking_m_s2,
    }
    for section in ("traffic", "strict", "ego", "simulation"):
        settings = asdict(getattr(config, section))
        facts |= {f"{section}.{name}": value for name, value in settings.items()}
    if not config.traffic.truck_share:
        del facts["traffic.truck_acceleration_m_s2"]
    if label != "traffic":  # no settings of ours draw the headways of its vehicles
        facts["traffic.headway_min_s"] = math.inf
    for name, limit, reason in AT_MOST:
        if facts.get(name, 0.0) > facts[limit]:
            shown, bound = (word.replace("type traffic", f"type {label}") for word in (name, limit))
            raise ConfigError(
                f"Under the check strict {shown} must be at most {bound}, {facts[limit]:.10g}, and "
                f"not {facts[name]:.10g}, because {reason} fails otherwise: change one of them, or "
                f"take {FALLBACK_CHECK}."
            )


def _require_model(
    name: str, found: VehicleType, written: VehicleType, free: Collection[str] = ()
) -> None:
    """Raise ConfigError if a vehicle type has another SUMO model or parameter than ``written``.

    The attributes ``free`` may differ. With lanes that are divided, SUMO's default is SL2015.
    """
    its = {"laneChangeModel": "SL2015", **dict(found.model)}.items()
    changed = sorted({key for key, _ in its ^ set(written.model)} - set(free))
    if changed:
        key = changed[0]
        values = [dict(kind.model).get(key, "the default of SUMO") for kind in (written, found)]
        raise ConfigError(
            f"Under the check strict the {key} of the vehicle type {name} must be {values[0]}, "
            f"and not {values[1]}: undo the change, or take {FALLBACK_CHECK}."
        )


def _require_one_vehicle_abreast(
    config: Config, vehicle_types: VehicleTypes, road: Road, label: str
) -> None:
    """Raise ConfigError if two vehicles can drive beside each other in one lane."""
    lane_m = road.lane_width_m
    resolution_m = config.simulation.strip_width_m(lane_m)
    if resolution_m < lane_m:
        raise _refusal(
            "simulation.lateral_resolution_m",
            f"at least the lane width, {lane_m}, and not {resolution_m:g}",
            "bound 3 fails: vehicles drive beside each other in a lane of several strips",
        )
    widths_m = _widths_m(config, vehicle_types, label)
    name, width_m = min(widths_m.items(), key=lambda item: item[1])
    widest_m = 2 * width_m + LATERAL_GAP_M
    if lane_m > widest_m + ROUNDING_M:
        what, bound = "the scenario's lane_width_m", f"at most {widest_m:.10g}, and not {lane_m}"
        if width_m < AS_WRITTEN.traffic.width_m:  # no road has lanes so narrow
            what = name
            bound = f"at least {(lane_m - LATERAL_GAP_M) / 2:.10g}, and not {width_m:.10g}"
        reason = "bound 3 fails: two vehicles fit beside each other in a lane"
        raise _refusal(what, bound, reason)


def _widths_m(config: Config, vehicle_types: VehicleTypes, label: str) -> dict[str, float]:
    """Return the widths of both vehicle types, and of trucks if there are any, by name.

    ``label`` is the name of the type of the other vehicles.
    """
    widths_m = {
        "the width of the vehicle type ego": vehicle_types.ego.width_m,
        f"the width of the vehicle type {label}": vehicle_types.traffic.width_m,
    }
    if config.traffic.truck_share:
        widths_m["traffic.truck_width_m"] = config.traffic.truck_width_m
    return widths_m


def _require_narrow_vehicles(
    config: Config, vehicle_types: VehicleTypes, road: Road, label: str
) -> None:
    """Raise ConfigError if a vehicle within ``ARRIVED_M`` of a centre may be in two lanes."""
    most_m = road.lane_width_m - 2 * ARRIVED_M
    for name, width_m in _widths_m(config, vehicle_types, label).items():
        if width_m > most_m + ROUNDING_M:
            raise _refusal(
                name,
                f"at most {most_m:.10g}, and not {width_m:.10g}",
                "bound 3 fails: a wider vehicle overlaps the next lane while it keeps its own",
            )


def _require_a_decision_on_the_line(config: Config, ego: VehicleType, road: Road) -> None:
    """Raise ConfigError unless the ego can still abort a lane change when its body changes lanes.

    A decision must fall between the time at which the ego's body crosses the marking between the
    two lanes and the time at which its centre does. Between two decisions the ego moves sideways by
    a constant distance. At each decision it is a multiple of this distance away from the centre of
    one of the two lanes.
    """
    duration_s, lane_m = config.ego.lane_change_duration_s, road.lane_width_m
    stride_m = lane_m / duration_s * config.simulation.decision_interval_s
    crosses_m, turns_m = (lane_m - ego.width_m) / 2 + LINE_M, lane_m / 2 - ON_LINE_M
    walked_m = stride_m * np.arange(np.ceil(lane_m / stride_m))
    places_m = np.concatenate((walked_m, lane_m - walked_m))
    starts_m = places_m[places_m <= crosses_m + ROUNDING_M]
    if (starts_m + stride_m >= turns_m - ROUNDING_M).any():
        enough_s = lane_m * config.simulation.decision_interval_s / (turns_m - crosses_m)
        raise _refusal(
            "ego.lane_change_duration_s",
            f"at least {math.ceil(100 * enough_s) / 100:g}, or one of some shorter ones, and not "
            f"{duration_s:g}",
            "the lemma abort fails: the centre of the ego may cross a lane's line in the decision "
            "in which its body does, too late to turn back",
        )


def _require_a_long_loop(config: Config, vehicle_types: VehicleTypes, road: Road) -> None:
    """Raise ConfigError if the loop is too short.

    On a loop, a vehicle that moves in behind the ego is also ahead of it. The gap from the ego
    forward to this vehicle must be at least the largest ``cut_in_gap``.
    """
    ego = config.ego
    farthest = (ego.max_speed_m_s, ego.accelerate_m_s2, 0.0)
    gap_m = float(cut_in_gap(*farthest, config.strict, ego, config.simulation))
    longest_m = config.traffic.longest_m(vehicle_types.traffic.length_m)
    least_m = gap_m + longest_m + vehicle_types.ego.length_m
    if road.is_loop and road.lap_m < least_m:
        raise _refusal(
            "the scenario's circumference_m",
            f"at least {math.ceil(10 * least_m) / 10:g}, and not {road.lap_m:g}",
            f"bound 3 fails: the ego may need {gap_m:.1f} m behind a vehicle that moves in behind "
            "it, and round a shorter loop this vehicle is ahead of it",
        )
