"""The experiments of ``drl-av reproduce`` by name."""

from drl_av.studies.reproduction.curves import curves
from drl_av.studies.reproduction.scale import Experiment

EXPERIMENTS: dict[str, Experiment] = {"curves": curves}
"""Those of ``scale.EXPERIMENTS``, which tells what they are."""
