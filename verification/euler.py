"""The integration methods of the simulator of ``adversary.py``."""

from enum import Enum

from drl_av.arrays import FloatArray


class Integration(Enum):
    """Integration method: the speed at which a vehicle moves in a step that changes its speed."""

    EULER = "euler"
    """Semi-implicit Euler, SUMO's default: the speed after the step."""
    BALLISTIC = "ballistic"
    """The mean of the speeds before and after the step."""
    EXPLICIT = "explicit"
    """Explicit Euler, eq. 5 of the paper: the speed before the step."""

    def mean_speed(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return the speed during a step, m/s, from the speeds before and after the step."""
        if self is Integration.BALLISTIC:
            return (before + after) / 2
        return after if self is Integration.EULER else before
