"""The integration methods of the kinematic simulator."""

from enum import Enum

from drl_av.traffic.road import FloatArray


class Integration(Enum):
    """Integration method: at which speed a vehicle moves in a step that changes its speed."""

    EULER = "euler"
    """Semi-implicit, as SUMO does by default: at the speed after the step."""
    BALLISTIC = "ballistic"
    """At the mean of both speeds."""
    EXPLICIT = "explicit"
    """Explicit Euler, eq. 5 of the paper: at the speed before the step."""

    def mean_speed(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return the speed at which a vehicle moves in a step, m/s, from those before and after."""
        if self is Integration.BALLISTIC:
            return (before + after) / 2
        return after if self is Integration.EULER else before
