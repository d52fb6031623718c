"""Evaluates drivers: comparison, statistics, recording and replay."""

DENSITIES = (1, 5, 10, 15, 20, 25, 30)
"""The numbers of vehicles around the ego in the published tables (docs/results)."""

PROVENANCE = ".provenance.json"
"""Ending of the file with the provenance of a table of evaluate (how it was made)."""
NEAR_MISS_TTC_S = 1.5
"""Critical time to collision (van der Horst and Hogema 1993)."""
NEAR_MISS_DRAC_M_S2 = 3.35
"""Critical deceleration rate to avoid a crash (Archer 2005)."""

LOKY, RAY = "loky", "ray"
"""The engines that can distribute trainings and evaluations over processes: joblib's loky on this
machine, or Ray on a cluster."""

PASS_CRITERION = (
    "A driver passes if it passes each criterion over all episodes: speed (it is faster than the "
    "fastest rule-based driver beside it: the 95 percent interval of the gain, paired by traffic, "
    "lies above 0); collisions (its ego hits something in no more episodes than with the "
    "rule-based driver that hits least, and the interval of the difference lies below 2 percent of "
    "the episodes); hard brakes (in a kilometre, no more than the fastest one: the paired interval "
    "has no part above 0); with --criticality, comfort (no smaller a share of its decisions is "
    "within nuPlan's bounds). If the road has an exit, or if the ego starts in a lane that ends, "
    "also exit or merge (it misses or fails in no more episodes), and it is compared with the "
    "fastest of those that miss or fail least. It fails a criterion if the interval lies on the "
    "wrong side; where the intervals overlap, the criterion is undecided: more episodes decide it."
)
"""The criterion in words, for the help and the documentation."""
