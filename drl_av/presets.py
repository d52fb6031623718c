"""Whole configs by name."""

from drl_av.config import Config
from drl_av.errors import ConfigError
from drl_av.settings import did_you_mean

PRESETS: dict[str, Config] = {
    "paper": Config(),
    "fast": Config().updated(
        "learning",
        episodes=300,
        epsilon_fraction=0.5,
        learning_rate=1e-3,
        learning_rate_end_fraction=0.01,
        epsilon_end=0.1,
        gradient_steps=3,
        mirrored=True,
        target_update_episodes=2,
    ),
}


def preset(name: str) -> Config:
    """The settings of a named preset; raises ConfigError with the nearest name."""
    if name not in PRESETS:
        raise ConfigError(
            f"There is no preset {name!r}{did_you_mean(name, PRESETS)}; "
            f"the presets are: {', '.join(PRESETS)}."
        )
    return PRESETS[name]
