"""Presets, which are complete configs with a name, and the config of a continual adaptation."""

import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from drl_av.config import SINGLE_PRESETS, Config, PpoConfig, from_sections, load_config
from drl_av.config.section import did_you_mean, there_is_no
from drl_av.config.traffic import NUMBERS
from drl_av.errors import ConfigError

LITERAL: dict[str, dict[str, Any]] = {
    "safety": {"printed_rule_1": True, "printed_rule_3": True, "printed_idm": True},
    "reward": {"desired": "best-lane", "speed_tolerance_m_s": 0.0},
}
"""The settings of the preset ``literal``: the paper as printed, see ``docs/choices.md``."""
PRESETS: dict[str, Config] = {
    "paper": Config(),
    "large": Config()
    .updated("simulation", world="twin")
    .updated("learning", algorithm="ppo")
    .updated("safety", check="strict")
    .updated("traffic", presets=SINGLE_PRESETS, vehicles_max=40)
    .updated("ppo", asymmetric_critic=True, decisions=15_000_000, learning_rate=1e-3)
    .updated("ppo", discount=0.98, gae_lambda=0.8, short_headway_cost=0.2)
    .updated("ppo", lane_units=48, hidden_1=96, hidden_2=96),
    "literal": from_sections(LITERAL),
}


def _with_ramps(name: str, scenario: str) -> Config:
    """Return a preset on a road with ramps, whose lanes the driver observes, under ``strict``."""
    return (
        PRESETS[name]
        .with_traffic("calm")
        .updated("simulation", scenario=scenario)
        .updated("observation", way=True)
        .updated("safety", check="strict")
    )


for _scenario in ("merge", "exit", "ramp_to_ramp"):
    PRESETS[f"paper-{_scenario}"] = _with_ramps("paper", _scenario)
_LARGE: dict[str, dict[str, Any]] = {
    "merge": {"decisions": 3_000_000, "lane_units": 48, "hidden_1": 96, "hidden_2": 96},
    "exit": {"decisions": 3_000_000, "forced_brake_cost": 20.0},
    "ramp_to_ramp": {"decisions": 4_000_000, "forced_brake_cost": 1.0, "discount": 0.995},
}
for _scenario, _own in _LARGE.items():
    PRESETS[f"large-{_scenario}"] = (
        _with_ramps("large", _scenario)
        .updated("traffic", presets=("calm", "overtaking", "naturalistic"))
        .updated("ppo", **asdict(PpoConfig(collision_cost=100.0, **_own)))
    )


def preset(name: str) -> Config:
    """Return the config of a preset.

    Raises:
        ConfigError: there is no preset ``name``; the message suggests the nearest name.
    """
    if name not in PRESETS:
        raise ConfigError(there_is_no("preset", name, "presets", PRESETS))
    return PRESETS[name]


def as_config(
    given: Config | Mapping[str, Any] | str | Path | None,
    base: Config | None = None,
    traffic: str | None = None,
) -> Config:
    """Convert the argument ``config`` of the public functions and environments to a Config.

    Args:
        given: A Config, the name of a preset, the path of a TOML file, a dictionary ``{section:
            {key: value}}``, or None. A file or a dictionary replaces settings of ``base``; None
            returns ``base``.
        base: The config to start from; by default the paper's settings.
        traffic: The kind of traffic, if it is named beside the config: it replaces the traffic of a
            Config, a preset or ``base``, and a file or a dictionary may change its settings.

    Raises:
        ConfigError: ``given`` is none of these, or a setting is unknown, has a wrong type or is out
            of bounds.
    """
    if isinstance(given, str) and given in PRESETS:
        given = PRESETS[given]
    if isinstance(given, Config):
        given, base = None, given
    if traffic is not None:
        base = (base or Config()).with_traffic(traffic)
    is_file = isinstance(given, Path) or (isinstance(given, str) and os.path.exists(given))
    if isinstance(given, Mapping):
        return keeping_kind(traffic, base, from_sections(given, base))
    if given is None or is_file:
        return keeping_kind(traffic, base, load_config(given, base))
    raise ConfigError(
        f"config is {given!r}{did_you_mean(given, PRESETS)}, but must be a preset "
        f"({', '.join(PRESETS)}), a TOML file that exists, sections as in "
        "{'traffic': {'vehicles_max': 5}}, or a Config."
    )


def keeping_kind(named: str | None, base: Config | None, config: Config) -> Config:
    """Return ``config``, which was made from ``base``, whose traffic is the kind ``named``.

    Raises:
        ConfigError: a kind was named, but the config has other ``traffic.presets``, or all that
            tells another kind from the named one.
    """
    if named is None or base is None:
        return config
    own, found, other = asdict(base.traffic), asdict(config.traffic), ""
    if found["presets"] != own["presets"]:
        other = f"traffic.presets = {[*config.traffic.presets]}"
    elif not own["presets"]:
        most = 0
        for kind in SINGLE_PRESETS:
            telling = asdict(base.with_traffic(kind).traffic).items() - own.items()
            if len(telling) > most and telling <= found.items():
                other, most = f"the traffic {kind}", len(telling)
    if other:
        raise ConfigError(
            f"The traffic is {named}, but the settings beside it have {other}: leave the traffic "
            f'out, or name it behind them (-o traffic.kind={named}; in Python kind="{named}" in '
            "the section traffic)."
        )
    return config


def require_driving_setting(name: str, shown: str, numbers: str) -> None:
    """Raise ConfigError if only trainings use the setting ``name``, ``section.key``.

    ``shown`` is how the user gave it, ``numbers`` where numbers of vehicles are given.
    """
    remedy = ""
    if name in [f"traffic.{number}" for number in NUMBERS]:
        remedy = f": give the numbers here with {numbers}"
    elif name.startswith(("learning.", "ppo.")):
        remedy = ", which ended: leave it out"
    if remedy:
        raise ConfigError(f"{shown} is a setting of trainings{remedy}.")


def adaptation(config: Config) -> Config:
    """Return the settings to continue the training of a driver that was trained with ``config``.

    Sec. IV-D of the paper prescribes greedy actions, 30,000 episodes and a lower learning rate,
    here 1e-5. The rest is ours:

    - After each decision there is one gradient step.
    - A minibatch has as many transitions as in the preset ``paper``.
    - Learning starts after 64 collision transitions, or as many as Buf_C can hold, because a
      minibatch would otherwise contain the same few several times.
    - The importance exponent of prioritized replay is always 1.
    """
    return config.updated(
        "learning",
        episodes=30_000,
        epsilon_start=0.0,
        epsilon_end=0.0,
        learning_rate=1e-5,
        learning_rate_end_fraction=1.0,
        gradient_steps=1,
        batch_size=PRESETS["paper"].learning.batch_size,
        importance_exponent_start=1.0,
        collisions_to_start=min(64, config.learning.collision_capacity),
        evaluate_every=1_000,
        checkpoint_every=200,
    )
