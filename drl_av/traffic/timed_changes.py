"""Lane changes at fixed times, by vehicles that a scenario places (ours)."""

from collections.abc import Collection, Sequence
from typing import Any

from drl_av.errors import ScenarioError

TimedChange = tuple[float, int]
"""The time since the start of the episode, seconds, and the lane to which the vehicle changes."""
LATEST_S = 86_400.0


def read_changes(changes: Any, vehicle: str, lane: int) -> tuple[TimedChange, ...]:
    """Return the lane changes of a placed vehicle as a tuple of (time, lane).

    ``vehicle`` is its id, ``lane`` the lane in which it starts.

    Raises:
        ScenarioError: ``changes`` are not pairs of a time and a lane, the vehicle is the ego, the
            times do not increase, or a change does not lead to an adjacent lane.
    """
    if not isinstance(changes, list | tuple) or not all(map(_is_change, changes)):
        raise ScenarioError(
            f"Vehicle {vehicle!r}: lane_changes is {changes!r}, but must be pairs [time, lane] of "
            f"a number of seconds from 0 to {LATEST_S:g} and a whole number."
        )
    if changes and vehicle == "ego":
        raise ScenarioError(
            "The ego has lane_changes, but its driver decides its lanes: leave them out."
        )
    found = tuple((float(time_s), int(to)) for time_s, to in changes)
    before_s, beside = -1.0, lane
    for time_s, to in found:
        if time_s <= before_s or abs(to - beside) != 1:
            raise ScenarioError(
                f"Vehicle {vehicle!r}: lane_changes has {time_s:g} s to lane {to}, but each change "
                f"must come after the one before and lead to a lane beside it, here {beside}."
            )
        before_s, beside = time_s, to
    return found


def _is_change(change: Any) -> bool:
    return (
        isinstance(change, list | tuple)
        and len(change) == 2
        and type(change[0]) in (int, float)
        and 0 <= change[0] <= LATEST_S
        and type(change[1]) is int
    )


def check_changes(vehicle: Any, lanes: Collection[int]) -> None:
    """Raise ScenarioError if a placed vehicle changes to a lane that is not one of ``lanes``."""
    for time_s, to in vehicle.lane_changes:
        if to not in lanes:
            raise ScenarioError(
                f"Vehicle {vehicle.id!r} changes to lane {to} at {time_s:g} s, but must change to "
                f"one of the lanes along the whole road: {', '.join(map(str, lanes))}."
            )


class TimedChanges:
    """The lane changes that placed vehicles have still to begin in an episode."""

    def __init__(self, placed: Sequence[Any]) -> None:
        self._waiting = [
            (time_s, vehicle.id, to) for vehicle in placed for time_s, to in vehicle.lane_changes
        ]

    def due(self, time_s: float) -> list[tuple[str, int]]:
        """Return (vehicle id, lane) of each change whose time has come since the last call.

        ``time_s`` is the time since the start of the episode, seconds.
        """
        due = [(name, to) for at_s, name, to in self._waiting if at_s <= time_s]
        self._waiting = [change for change in self._waiting if change[0] > time_s]
        return due
