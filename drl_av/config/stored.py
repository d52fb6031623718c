"""Reading the settings that a run has stored in its ``config.toml``.

The file must contain all settings except those in ``ADDED_LATER``; a truncated file is an error.
"""

import tomllib
from pathlib import Path
from typing import Any

from drl_av.config import OLD_DEFAULTS, RENAMED, Config, load_config
from drl_av.config.reference import settings
from drl_av.errors import ConfigError

ADDED_LATER = {
    ("traffic", "all_kinds"),
    ("traffic", "overtake_right"),
    ("learning", "algorithm"),
    ("learning", "permitted_only"),
    ("learning", "abort_margin"),
    ("learning", "acceleration_margin"),
    ("traffic", "keep_stopping_distance"),
    *(("traffic", f"truck_{name}") for name in ("share", "length_m", "width_m")),
    *(("traffic", f"truck_speed_{end}_m_s") for end in ("min", "max")),
    ("traffic", "truck_acceleration_m_s2"),
    *(("traffic", f"{kind}_share") for kind in ("standing", "crawling", "fast", "hard_braking")),
    *(("traffic", f"fast_{name}") for name in ("speed_m_s", "speed_gain")),
    ("traffic", "crawling_speed_max_m_s"),
    ("traffic", "hard_brakes_per_s"),
    ("traffic", "hard_brake_s"),
    ("ego", "overtake_right"),
    ("observation", "way"),
    *(("safety", f"printed_{rule}") for rule in ("rule_1", "rule_3", "idm")),
}
"""The (section, key) of settings that files of older versions lack; they have default values."""
WHOLE_SECTIONS_ADDED_LATER = {"ppo"}
"""The sections that files of older versions lack."""


def load_stored(path: Path) -> Config:
    """Return the config in a run's ``config.toml``; it may lack only settings of ``ADDED_LATER``.

    Raises:
        ConfigError: the file cannot be read, is not a valid config, is truncated, or lacks a
            setting.
    """
    config = load_config(path, OLD_DEFAULTS)
    text = path.read_text(encoding="utf-8-sig")
    document: dict[str, Any] = tomllib.loads(text)
    stored = {(section, key) for section, part in document.items() for key in part}
    stored |= {(section, RENAMED.get((section, key), key)) for section, key in stored}
    absent = WHOLE_SECTIONS_ADDED_LATER - document.keys()
    for each in settings(config):
        if each.section not in absent and (each.section, each.key) not in stored | ADDED_LATER:
            raise _not_whole(path, f"it lacks {each.section}.{each.key}")
    if not text.endswith("\n"):
        raise _not_whole(path, "its last line has no end")
    return config


def _not_whole(path: Path, reason: str) -> ConfigError:
    """Return the error for an incomplete ``config.toml``; ``reason`` says how it is incomplete."""
    return ConfigError(
        f"{path} is not whole, {reason}: put back the config.toml that the run was begun with, "
        "or begin a new run."
    )
