"""``planner``: a driver that searches at decision time, in forecasts of all vehicles (ours)."""

from drl_av.drivers.planner.driver import PlannerDriver

__all__ = ["PlannerDriver"]
