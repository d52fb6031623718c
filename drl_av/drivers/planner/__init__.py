"""The driver ``planner`` (ours): compares plans in forecasts of all vehicles as it drives."""

from drl_av.drivers.planner.driver import PlannerDriver

__all__ = ["PlannerDriver"]
