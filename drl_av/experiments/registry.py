"""Lists the experiments of ``drl-av reproduce`` by name, in the order in which they run."""

from drl_av.experiments.adaptation import ADAPTATION
from drl_av.experiments.barricade import BARRICADE
from drl_av.experiments.comfort import COMFORT
from drl_av.experiments.cross_table import CROSS_TABLE
from drl_av.experiments.curves import CURVES
from drl_av.experiments.density_sweep import DENSITY_SWEEP
from drl_av.experiments.experiment import Experiment
from drl_av.experiments.fast import FAST
from drl_av.experiments.final_policies import FINAL_POLICIES
from drl_av.experiments.literal import LITERAL_PAPER
from drl_av.experiments.opponents import OPPONENTS_SWEEP
from drl_av.experiments.real_bounds import REAL_BOUNDS
from drl_av.experiments.straight import STRAIGHT
from drl_av.experiments.strictness import STRICT
from drl_av.experiments.training_seeds import TRAINING_SEEDS
from drl_av.experiments.variations import (
    BARRICADE_PRETRAINED,
    CHECK_PAPER,
    CHECK_PERMIT_ALL,
    EXACT_SPEED,
    REFERENCE_ACC,
)

EXPERIMENTS: dict[str, Experiment] = {
    experiment.name: experiment
    for experiment in (
        CURVES,
        FINAL_POLICIES,
        FAST,
        DENSITY_SWEEP,
        OPPONENTS_SWEEP,
        COMFORT,
        STRAIGHT,
        CROSS_TABLE,
        TRAINING_SEEDS,
        CHECK_PAPER,
        CHECK_PERMIT_ALL,
        REFERENCE_ACC,
        EXACT_SPEED,
        LITERAL_PAPER,
        BARRICADE_PRETRAINED,
        STRICT,
        REAL_BOUNDS,
        ADAPTATION,
        BARRICADE,
    )
}
