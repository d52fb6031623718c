"""Lists the studies by name, in the order in which they run."""

from studies.adaptation import ADAPTATION
from studies.barricade import BARRICADE
from studies.learning_curves import CURVES
from studies.options import FOLDER, Study
from studies.study import FileStudy

PROGRAMS = {study.name: study for study in (CURVES, ADAPTATION, BARRICADE)}
ORDER = (
    *("curves", "final_policies", "fast", "density_sweep", "opponents", "comfort", "straight"),
    *("cross_table", "training_seeds", "check_paper", "check_permit_all", "reference_acc"),
    *("exact_speed", "literal", "barricade_pretrained", "strict", "real_bounds", "adaptation"),
    "barricade",
)
"""The studies of this repository; files that are not named follow in alphabetical order."""
_FILES = {path.stem: FileStudy(path) for path in sorted(FOLDER.glob("*.toml"))}
_FOUND: dict[str, Study] = {**_FILES, **PROGRAMS}
STUDIES: dict[str, Study] = {name: _FOUND[name] for name in dict.fromkeys((*ORDER, *_FOUND))}
