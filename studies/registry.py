"""Lists the studies by name, in the order in which they run."""

from studies.adaptation import ADAPTATION
from studies.barricade import BARRICADE
from studies.learning_curves import CURVES
from studies.options import FOLDER, Program
from studies.study import FileStudy

Study = FileStudy | Program
PROGRAMS = {study.name: study for study in (CURVES, ADAPTATION, BARRICADE)}
ORDER = (
    *("opponents", "comfort", "straight", "strict", "check", "curves", "final_policies"),
    *("density_sweep", "whole_schedule", "literal", "adaptation", "barricade"),
)
"""The studies of this repository; files that are not named follow in alphabetical order."""
_FILES = {path.stem: FileStudy(path) for path in sorted(FOLDER.glob("*.toml"))}
_FOUND: dict[str, Study] = {**_FILES, **PROGRAMS}
STUDIES: dict[str, Study] = {name: _FOUND[name] for name in dict.fromkeys((*ORDER, *_FOUND))}
