"""A reference of all settings (meaning, unit, bounds, source) for TOML files and the docs."""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any, NamedTuple

import tomli_w

from drl_av.config import Config
from drl_av.config.section import meanings, there_is_no
from drl_av.errors import ConfigError

UNITS = {
    "_m_s2": "m/s²",
    "_per_s2": "1/s²",
    "_per_s": "1/s",
    "_per_m": "1/m",
    "_m_s": "m/s",
    "_m": "m",
    "_s": "s",
}
"""The unit of a setting by the ending of its name; the first ending that matches decides."""


SECTIONS: tuple[str, ...] = tuple(item.name for item in fields(Config))


class Setting(NamedTuple):
    """One setting of a config, with what its class says of it."""

    section: str
    key: str
    value: Any
    default: Any
    meaning: str
    source: str
    """A table, equation or section of the paper, another paper, or "ours"."""
    unit: str
    """For example "m/s"; empty for a setting without a unit."""
    allowed: str
    """The allowed values in words, for example "0 to 1"."""


def settings(config: Config, section: str | None = None) -> Iterator[Setting]:
    """Yield all settings of a config, or those of one section, in the order of the TOML file.

    Raises:
        ConfigError: there is no such section.
    """
    for name in _sections(section):
        part = getattr(config, name)
        meant = meanings(type(part))
        for item in fields(part):
            yield Setting(
                section=name,
                key=item.name,
                value=getattr(part, item.name),
                default=item.default,
                meaning=meant[item.name].text,
                source=meant[item.name].source,
                unit=next((UNITS[end] for end in UNITS if item.name.endswith(end)), ""),
                allowed=_allowed(item.default, item.metadata),
            )


def section_meaning(section: str) -> str:
    """Return the meaning of a section, which is the first line of the docstring of its class."""
    return str(type(getattr(Config(), section)).__doc__).splitlines()[0]


def annotated_toml(config: Config, section: str | None = None) -> str:
    """Return the config, or one section, as TOML text with a comment above each setting.

    ``from_toml`` reads the text back.

    Raises:
        ConfigError: there is no such section.
    """
    parts = []
    for name in _sections(section):
        lines = [f"# {section_meaning(name)}", f"[{name}]"]
        for setting in settings(config, name):
            lines += [*_comment(setting), tomli_w.dumps({setting.key: setting.value}).rstrip()]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def _sections(section: str | None) -> tuple[str, ...]:
    """Return ``section`` alone, or all sections for None; raise ConfigError for an unknown one."""
    if section is None:
        return SECTIONS
    if section not in SECTIONS:
        raise ConfigError(there_is_no("section", section, "sections", SECTIONS))
    return (section,)


def _allowed(default: Any, meta: Any) -> str:
    """Describe in words the allowed values of a setting with this default and field metadata."""
    if meta.get("choices") is not None:
        return "one of " + ", ".join(meta["choices"])
    if isinstance(default, bool):
        return "true or false"
    if isinstance(default, tuple):
        return "a list of names"
    low, high = meta.get("low"), meta.get("high")
    if low is None and high is None:
        return "text" if isinstance(default, str) else "any number"
    if high is None:
        return f"at least {low:.10g}"
    return f"{low:.10g} to {high:.10g}"


def _comment(setting: Setting) -> list[str]:
    """Return the comment lines of a setting: meaning, then unit, bounds, source and default."""
    facts = [setting.unit, setting.allowed, f"source: {setting.source}"]
    if setting.value != setting.default:
        facts.append(f"default: {written(setting.default)}")
    return [f"# {setting.meaning}", f"#   {'; '.join(fact for fact in facts if fact)}"]


def written(value: Any) -> str:
    """Return a value in TOML notation."""
    return tomli_w.dumps({"x": value}).removeprefix("x = ").rstrip()
