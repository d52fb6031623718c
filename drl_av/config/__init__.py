"""The settings of drl-av: frozen dataclasses that are read from and written to TOML files.

"The paper" is Nageshrao, Tseng and Filev, *Autonomous Highway Driving using Deep Reinforcement
Learning* (2019). Each setting names the source of its default: a table, equation or section of the
paper ("Table I", "Sec. IV-B"), another publication, or "ours" if the paper does not state
it. A setting's name ends with its unit, as in ``headway_s``; lower and upper bounds are inclusive.
"""

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import tomli_w

from drl_av.config.drivers import DriverConfig as DriverConfig
from drl_av.config.drivers import FiniteStateConfig as FiniteStateConfig
from drl_av.config.drivers import Level0Config as Level0Config
from drl_av.config.drivers import MobilConfig as MobilConfig
from drl_av.config.ego import DESIRED_VALUES as DESIRED_VALUES
from drl_av.config.ego import EgoConfig as EgoConfig
from drl_av.config.ego import ObservationConfig as ObservationConfig
from drl_av.config.ego import RewardConfig as RewardConfig
from drl_av.config.learning import REPLAYS as REPLAYS
from drl_av.config.learning import LearningConfig as LearningConfig
from drl_av.config.learning import PpoConfig as PpoConfig
from drl_av.config.safety import SafetyConfig as SafetyConfig
from drl_av.config.safety import StrictConfig as StrictConfig
from drl_av.config.section import did_you_mean
from drl_av.config.simulation import SimulationConfig as SimulationConfig
from drl_av.config.traffic import NUMBERS
from drl_av.config.traffic import SINGLE_PRESETS as SINGLE_PRESETS
from drl_av.config.traffic import TRAFFIC_PRESETS as TRAFFIC_PRESETS
from drl_av.config.traffic import TrafficConfig as TrafficConfig
from drl_av.config.traffic import traffic_preset as traffic_preset
from drl_av.errors import ConfigError


@dataclass(frozen=True)
class Config:
    """All settings of a run, one attribute for each section; immutable, compared by value."""

    simulation: SimulationConfig = SimulationConfig()
    traffic: TrafficConfig = TrafficConfig()
    ego: EgoConfig = EgoConfig()
    safety: SafetyConfig = SafetyConfig()
    strict: StrictConfig = StrictConfig()
    driver: DriverConfig = DriverConfig()
    mobil: MobilConfig = MobilConfig()
    finite_state: FiniteStateConfig = FiniteStateConfig()
    level_0: Level0Config = Level0Config()
    reward: RewardConfig = RewardConfig()
    observation: ObservationConfig = ObservationConfig()
    ppo: PpoConfig = PpoConfig()
    learning: LearningConfig = LearningConfig()

    def updated(self, section: str, **settings: Any) -> "Config":
        """Return a copy of this config in which some settings of one section are replaced.

        Raises:
            ConfigError: a value has a wrong type or is out of bounds.
        """
        return replace(self, **{section: replace(getattr(self, section), **settings)})

    def with_traffic(self, kind: object) -> "Config":
        """Return a copy with the traffic settings of ``kind``, a key of ``TRAFFIC_PRESETS``.

        ``vehicles_min`` and ``vehicles_max`` keep their values.

        Raises:
            ConfigError: there is no such kind.
        """
        return replace(self, traffic=traffic_preset(kind, self.traffic))

    def __post_init__(self) -> None:
        for name in self.traffic.presets:
            if name not in SINGLE_PRESETS:
                raise ConfigError(
                    f"traffic.presets has {name!r}{did_you_mean(name, SINGLE_PRESETS)}, but its "
                    f"kinds of traffic are: {', '.join(SINGLE_PRESETS)}."
                )

    @property
    def per_traffic_preset(self) -> "list[Config]":
        """One config for each of ``traffic.presets``; without any, only this one."""
        return [*map(self.with_traffic, self.traffic.presets)] or [self]

    @property
    def without_training(self) -> "Config":
        """This config with the default settings of trainings, on which no evaluation depends."""
        usual = {name: getattr(TrafficConfig, name) for name in NUMBERS}
        cleared = replace(self, learning=LearningConfig(), ppo=PpoConfig())
        return cleared.updated("traffic", **usual)

    def to_toml(self) -> str:
        """Return all settings as TOML text; ``from_toml`` converts it back to an equal config."""
        return tomli_w.dumps(asdict(self))


_SECTIONS: dict[str, Any] = {item.name: type(item.default) for item in fields(Config)}


def from_toml(text: str, base: Config | None = None, name: str = "config") -> Config:
    """Return a copy of ``base`` (default: the paper's config) with the settings of a TOML text.

    Settings that the text does not contain keep their values. Error messages contain ``name``.

    Raises:
        ConfigError: the text is not valid TOML, a section or key is unknown, or a value has a wrong
            type or is out of bounds.
    """
    return from_sections(_document(text, name), base, name)


def from_sections(
    sections: Mapping[str, Any], base: Config | None = None, name: str = "config"
) -> Config:
    """Return a copy of ``base`` (default: the paper's config) with the settings of a dictionary.

    ``sections`` is ``{section: {key: value}}``. In the section ``traffic``, the key ``kind`` first
    selects a kind of traffic with all its settings; the other keys then change single settings.
    Error messages contain ``name``.

    Raises:
        ConfigError: a section or key is unknown, or a value has a wrong type or is out of bounds.
    """
    config = base if base is not None else Config()
    for section, settings in sections.items():
        if section not in _SECTIONS:
            shown = repr(str(section))[1:-1]
            raise ConfigError(
                f"{name} has no section [{shown}]{did_you_mean(section, _SECTIONS)}; "
                f"the sections are: {', '.join(_SECTIONS)}."
            )
        if not isinstance(settings, Mapping):
            raise ConfigError(f"{name}: {section} must be a section, written [{section}].")
        if section == "traffic" and "kind" in settings:
            if settings.get("presets"):
                raise ConfigError(
                    f"{name}: [traffic] has kind and presets, which draws a kind of traffic for "
                    "each episode: leave one of them out."
                )
            config = config.with_traffic(settings["kind"])
            settings = {key: value for key, value in settings.items() if key != "kind"}
        known = [item.name for item in fields(_SECTIONS[section])]
        for key in settings:
            if key not in known:
                known = ["kind", *known] if section == "traffic" else known
                raise ConfigError(
                    f"{name}: [{section}] has no key {key!r}{did_you_mean(key, known)}; "
                    f"its keys are: {', '.join(known)}."
                )
        config = config.updated(section, **settings)
    return config


def with_files(config: Config, paths: Iterable[str | Path]) -> Config:
    """Return the config with the settings of TOML files, each laid over those before it.

    A path may be a single setting instead, such as ``traffic.truck_share=0.2``. Settings that do
    not fit the config may fit it together with those after them. Raises ConfigError as
    ``load_config`` does.
    """
    waiting: dict[str, Any] = {}
    refusals: list[ConfigError] = []
    reasons = set[str]()
    for path in paths:
        is_setting = isinstance(path, str) and SETTING.match(path) and not _exists(path)
        found = _setting(str(path)) if is_setting else _document(_text(path), str(path))
        waiting = _laid_over(waiting, found)
        try:
            config = _in(str(path), waiting, config)
            waiting, refusals, reasons = {}, [], set()
        except ConfigError as error:
            refusals.append(error)
            reasons.add(str(error).replace(str(path), ""))
    if refusals:
        raise refusals[0 if len(reasons) == 1 else -1]
    return config


def _exists(path: str) -> bool:
    """Return whether there is such a path; the system refuses names that are too long."""
    try:
        return Path(path).exists()
    except OSError:
        return False


def _laid_over(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return sections with the settings of others laid over theirs; a kind of traffic resets it."""
    found = dict(below)
    for section, settings in above.items():
        if isinstance(settings, Mapping) and isinstance(found.get(section), Mapping):
            under = found[section]
            if section == "traffic" and "kind" in settings:
                under = {key: under[key] for key in under if key in KEPT_BY_KINDS}
            found[section] = {**under, **settings}
        else:
            found[section] = settings
    return found


KEPT_BY_KINDS = {"vehicles_min", "vehicles_max"}
"""The settings of [traffic] that ``with_traffic`` leaves as they are."""


SETTING = re.compile(r"(\w+)\.(\w+)=(.*)", re.DOTALL)
"""The form of a single setting: SECTION.KEY=VALUE, where VALUE is TOML or a text."""


def _setting(word: str) -> dict[str, Any]:
    """Return the section of a single setting."""
    found = SETTING.fullmatch(word)
    assert found is not None
    section, key, text = found.groups()
    try:
        read = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        read = {}
    return {section: {key: read["value"] if [*read] == ["value"] else text}}


def _document(text: str, name: str) -> dict[str, Any]:
    """Return the sections of a TOML text; raise ConfigError if it is not valid."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{name} is not valid TOML: {error}.") from error


def _in(name: str, sections: Mapping[str, Any], base: Config | None) -> Config:
    """Return what ``from_sections`` does; its errors contain ``name``."""
    try:
        return from_sections(sections, base, name)
    except ConfigError as error:
        raise ConfigError(str(error) if name in str(error) else f"In {name}: {error}") from error


def load_config(path: str | Path | None, base: Config | None = None) -> Config:
    """Return a copy of ``base`` with the settings of a TOML file, or ``base`` if ``path`` is None.

    The default of ``base`` is the paper's config.

    Raises:
        ConfigError: the file cannot be read or is not valid TOML, a section or key is
            unknown, or a value has a wrong type or is out of bounds; the message contains the path.
    """
    if path is None:
        return base or Config()
    return _in(str(path), _document(_text(path), str(path)), base)


def _text(path: str | Path) -> str:
    """Return the text of a TOML file; raise ConfigError if it cannot be read."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"The config file {path} is not UTF-8 text (byte {error.start}), but TOML is: save it "
            "as UTF-8, or name a TOML file."
        ) from error
    except (OSError, TypeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(
            f"The config file {path} cannot be read ({reason}): name a TOML file that exists."
        ) from error
