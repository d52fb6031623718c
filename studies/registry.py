"""Lists the experiments of ``python -m studies`` by name, in the order in which they run."""

from studies.adaptation import ADAPTATION
from studies.barricade import BARRICADE
from studies.comfort import COMFORT
from studies.cross_table import CROSS_TABLE
from studies.curves import CURVES
from studies.density_sweep import DENSITY_SWEEP
from studies.experiment import Experiment
from studies.fast import FAST
from studies.final_policies import FINAL_POLICIES
from studies.literal import LITERAL_PAPER
from studies.opponents import OPPONENTS_SWEEP
from studies.real_bounds import REAL_BOUNDS
from studies.straight import STRAIGHT
from studies.strictness import STRICT
from studies.training_seeds import TRAINING_SEEDS
from studies.variations import (
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
