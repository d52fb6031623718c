"""Evaluates drivers: comparison, statistics, recording and replay."""

DENSITIES = (1, 5, 10, 15, 20, 25, 30)
"""The numbers of vehicles around the ego in the published tables (docs/results)."""

LOKY, RAY = "loky", "ray"
"""The engines that can distribute trainings and evaluations over processes: joblib's loky on this
machine, or Ray on a cluster."""

PASS_CRITERION = (
    "A driver passes if, over all episodes, it is faster than the fastest rule-based driver beside "
    "it (the 95 percent interval of the gain, paired by traffic, lies above 0), if its ego hits "
    "something in no more episodes than with any rule-based driver, and if it brakes hard no more "
    "often in a kilometre than the fastest one; with --criticality also only if no smaller a share "
    "of its decisions is within nuPlan's bounds of comfort. If the road has an exit, or if the ego "
    "starts in a lane that ends, it must also miss its exit, or fail to merge, in no more episodes "
    "than any rule-based driver, and is compared with the fastest of those that miss or fail least."
)
"""The criterion in words, for the help and the documentation."""
