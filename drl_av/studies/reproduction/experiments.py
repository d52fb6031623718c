"""The experiments of ``drl-av reproduce`` by name, in the order in which they are made."""

from drl_av.studies.reproduction.adaptation import adaptation
from drl_av.studies.reproduction.barricade import barricade
from drl_av.studies.reproduction.curves import curves
from drl_av.studies.reproduction.ends import ends
from drl_av.studies.reproduction.fast import fast
from drl_av.studies.reproduction.published import figures
from drl_av.studies.reproduction.scale import Experiment
from drl_av.studies.reproduction.speeds import speeds
from drl_av.studies.reproduction.strictness import strictness
from drl_av.studies.reproduction.variations import variations

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
