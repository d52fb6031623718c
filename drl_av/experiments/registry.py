"""The experiments of ``drl-av reproduce`` by name, in the order in which they are made."""

from drl_av.experiments.adaptation import adaptation
from drl_av.experiments.barricade import barricade
from drl_av.experiments.curves import curves
from drl_av.experiments.density_sweep import speeds
from drl_av.experiments.fast import fast
from drl_av.experiments.figures import figures
from drl_av.experiments.final_policies import ends
from drl_av.experiments.options import Experiment
from drl_av.experiments.strictness import strictness
from drl_av.experiments.variations import variations

EXPERIMENTS: dict[str, Experiment] = {
    "curves": curves,
    "ends": ends,
    "fast": fast,
    "speeds": speeds,
    "variations": variations,
    "strict": strictness,
    "adaptation": adaptation,
    "barricade": barricade,
    "figures": figures,
}
"""Those of ``scale.MEANINGS``, which tells what they are."""
