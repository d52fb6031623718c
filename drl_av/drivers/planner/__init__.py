"""The driver ``planner`` (ours): it compares plans by forecasts of all vehicles."""
