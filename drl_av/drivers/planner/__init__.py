"""The driver ``planner`` (ours): it compares plans by forecasts of all vehicles."""

from drl_av.drivers.planner.driver import PlannerDriver

__all__ = ["PlannerDriver"]
