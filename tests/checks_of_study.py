"""The safety checks of the study ``strict``, by the names of its variants."""

from drl_av.config import Config
from studies.options import FOLDER, changed
from studies.study import FileStudy


def with_check(config: Config, bounds: str) -> Config:
    """Return the settings with another safety check.

    Args:
        config: The settings to change.
        bounds: ``"paper"`` for the check ``paper``, ``"strict"`` for the check ``strict`` with the
            bounds of ``config``, or ``"real"`` for ``strict`` with bounds of real traffic. They are
            the variants of ``strict.toml``.
    """
    study = FileStudy(FOLDER / "strict.toml")
    [settings] = [each.settings for each in study.variants if each.name == bounds]
    return changed(config, {"safety": {"check": "paper"}, **settings})
