"""Combines several stories: scenarios that place their vehicles and have the same road and ego."""

from collections.abc import Mapping
from dataclasses import fields, replace

from drl_av.errors import ScenarioError
from drl_av.road.snapshot import EGO_ID
from drl_av.scenarios.road_description import PlacedVehicle, RoadDescription
from drl_av.scenarios.road_types import road_type_name


def composed(stories: Mapping[str, RoadDescription]) -> RoadDescription:
    """Return the description of one scenario with the vehicles of all stories (ours).

    ``stories`` holds the descriptions by name; a single one is returned unchanged. If two stories
    place vehicles with the same speeds and lane changes at one place (less than a vehicle length
    apart in one lane), the result contains only the vehicle of the first story. An id that is
    already taken gets a number, such as ``slow_2``.

    Raises:
        ScenarioError: one of several stories places no vehicles, the stories have different roads
            or egos, or two stories place different vehicles at one place.
    """
    (name, base), *others = stories.items()
    names = name
    for empty in (each for each, story in stories.items() if others and not story.vehicles):
        raise ScenarioError(
            f"{empty} places no vehicles, but each of several stories must: leave it out."
        )
    for other, story in others:
        _require_one_road(name, base, other, story)
        names, vehicles = f"{names} and {other}", list(base.vehicles)
        for vehicle in story.vehicles:
            _add(vehicles, vehicle, base.vehicle_length_m, names)
        base = replace(base, vehicles=tuple(vehicles))
    return base


def _require_one_road(name: str, base: RoadDescription, other: str, story: RoadDescription) -> None:
    """Raise ScenarioError if two stories differ in more than their vehicles."""
    kinds = road_type_name(base), road_type_name(story)
    if kinds[0] != kinds[1]:
        raise ScenarioError(
            f"{name} is a scenario of the kind {kinds[0]} and {other} of the kind {kinds[1]}: put "
            "together stories on one road."
        )
    for item in fields(base):
        mine, theirs = getattr(base, item.name), getattr(story, item.name)
        if item.compare and item.name != "vehicles" and mine != theirs:
            raise ScenarioError(
                f"{item.name} is {mine!r} in {name} and {theirs!r} in {other}, but stories that "
                "are put together have one road: make them equal, or give the option."
            )


def _add(vehicles: list[PlacedVehicle], one: PlacedVehicle, length_m: float, names: str) -> None:
    """Add a vehicle of another story to ``vehicles``, unless it is there already.

    ``names`` holds the names of the stories, for messages.
    """
    if one.id == EGO_ID:
        ego = next((each for each in vehicles if each.id == EGO_ID), one)
        if ego != one:
            raise ScenarioError(
                f"The ego of {names} starts differently ({_start(ego)}, and {_start(one)}), but "
                "there is one ego: make them equal."
            )
    for other in vehicles:
        if other.lane == one.lane and abs(other.position_m - one.position_m) < length_m:
            alike = replace(other, id=one.id, position_m=one.position_m) == one
            if not alike or (other.id != one.id and EGO_ID in (other.id, one.id)):
                raise ScenarioError(
                    f"{names} place two different vehicles at one place, {other.id!r} "
                    f"({_start(other)}) and {one.id!r} ({_start(one)}): move one of them."
                )
            return
    taken = {each.id for each in vehicles}
    free = (one.id, *(f"{one.id}_{number}" for number in range(2, len(taken) + 3)))
    vehicles.append(replace(one, id=next(name for name in free if name not in taken)))


def _start(vehicle: PlacedVehicle) -> str:
    return f"lane {vehicle.lane}, {vehicle.position_m:g} m, {vehicle.speed_m_s:g} m/s"
