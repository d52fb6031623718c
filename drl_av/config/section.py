"""The schema of a section: dataclass fields with a meaning, a source, bounds and choices."""

import difflib
import inspect
import math
import re
import sys
from collections import defaultdict, namedtuple
from collections.abc import Iterable
from dataclasses import Field, field, fields
from pathlib import PurePath
from typing import Any, ClassVar, NamedTuple, Self, cast

from drl_av.errors import ConfigError, DrlAvError


def setting(
    default: Any,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] | None = None,
) -> Any:
    """Define a field with bounds or choices; ``meanings`` reads what the class says of it.

    Args:
        default: The default value; its type is the type of the setting.
        low: The smallest allowed value; None sets no lower bound.
        high: The largest allowed value; None sets no upper bound.
        choices: The allowed strings; None allows every string.
    """
    return field(default=default, metadata={"low": low, "high": high, "choices": choices})


class Meaning(NamedTuple):
    """What the docstring of a class says of one of its settings."""

    text: str
    source: str
    """The source of the default, for example "Table I" or "ours"."""


def meanings(described: type) -> dict[str, Meaning]:
    """Return the meaning of each setting of a class, by name.

    The docstrings of the class and of its base classes have a line ``NAME: MEANING (SOURCE)`` for
    each, which goes on in lines that are indented. Under ``python -OO``, which drops
    docstrings, every meaning is empty.
    """
    found: dict[str, Meaning] = {}
    if sys.flags.optimize > 1:
        found = defaultdict(lambda: Meaning("", ""))
    for kind in described.__mro__:
        text = re.sub(r"\n +", " ", inspect.cleandoc(kind.__doc__ or ""))
        for name, meaning, source in re.findall(r"^(\w+): (.*) \(([^()]*)\)$", text, re.MULTILINE):
            found.setdefault(name, Meaning(meaning, source))
    return found


def did_you_mean(word: object, names: Iterable[str]) -> str:
    """Return `` (did you mean 'NAME'?)`` for the name most similar to ``word``, "" if none is."""
    found = difflib.get_close_matches(str(word), list(names), n=1)
    return f" (did you mean {found[0]!r}?)" if found else ""


def not_one_of(what: str, word: object, names: Iterable[str]) -> str:
    """Return the sentence that a word is not one of the names, with the most similar of them."""
    names = list(names)
    hint = did_you_mean(word, names)
    return f"{what} is {word!r}{hint}, but must be one of: {', '.join(names)}."


def there_is_no(what: str, word: object, those: str, names: Iterable[str]) -> str:
    """Return the sentence that there is nothing of a name, with all names of ``those``."""
    names = list(names)
    hint = did_you_mean(word, names)
    return f"There is no {what} {word!r}{hint}; the {those} are: {', '.join(names)}."


def section_name(section: type) -> str:
    """Return the name of a section in TOML, for example ``finite_state`` for FiniteStateConfig."""
    words = re.findall(r"[A-Z][a-z]*|[0-9]+", section.__name__.removesuffix("Config"))
    return "_".join(words).lower()


_KINDS: dict[Any, str] = {
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    str: "a text",
    tuple: "a list",
}


def check_fields(described: Any, prefix: str, refusal: type[DrlAvError]) -> None:
    """Check each field that ``setting`` defines, and each of a section; convert it to its type.

    ``described`` is a dataclass object, changed in place: numpy scalars become Python numbers, ints
    floats, paths strings, and lists tuples, where the field has that type. None is allowed where it
    is the default.

    Raises ``refusal`` if a value has a wrong type, is not finite or out of bounds, or is not one of
    the choices; the message begins with ``prefix`` and the name of the field.
    """
    for item in fields(described):
        if not item.metadata and not isinstance(described, Section):
            continue
        value, kind = getattr(described, item.name), _kind(item)
        if value is None and item.default is None:
            continue
        value, name = _converted(value, kind), f"{prefix}{item.name}"
        low, high, choices = map(item.metadata.get, ("low", "high", "choices"))
        if choices is not None and value not in choices:
            raise refusal(not_one_of(name, value, choices))
        if (
            type(value) is not kind
            or (isinstance(value, float) and not math.isfinite(value))
            or (low is not None and value < low)
            or (high is not None and value > high)
        ):
            raise refusal(f"{name} is {value!r}, but must be {_KINDS[kind]}{_bounds(low, high)}.")
        object.__setattr__(described, item.name, value)


def _kind(item: Field[Any]) -> type:
    """Return the type of the values of a field, of which some may also be None."""
    if isinstance(item.type, type):
        return item.type
    return float if item.default is None else type(item.default)


def _bounds(low: float | None, high: float | None) -> str:
    """Return the bounds of a number in words; "" without any."""
    if low is None:
        return ""
    return f" of at least {low:.10g}" if high is None else f" from {low:.10g} to {high:.10g}"


def _converted(value: Any, kind: type) -> Any:
    """Convert a numpy scalar, int, path or list to ``kind``, the type of a field, if it fits."""
    if getattr(value, "shape", None) == () and callable(getattr(value, "item", None)):
        value = value.item()
    if kind is float and type(value) is int:
        return float(value) if abs(value) <= sys.float_info.max else math.inf
    if kind is tuple and isinstance(value, list):
        return tuple(value)
    return str(value) if kind is str and isinstance(value, PurePath) else value


class Section:
    """Base class of all sections; the constructor checks each field with ``check_fields``.

    Raises:
        ConfigError: a value has a wrong type, is out of bounds, or is not one of the choices.
    """

    _Numbers: ClassVar[Any]

    def __init_subclass__(cls) -> None:
        """Define the class of ``numbers``, by a name by which it can be pickled."""
        kinds = cls.__annotations__ | {
            name: value.fget.__annotations__["return"]
            for name, value in vars(cls).items()
            if isinstance(value, property)
        }
        names = [name for name, kind in kinds.items() if kind in (float, int, bool)]
        cls._Numbers = namedtuple("_Numbers", names, module=cls.__module__)  # type: ignore[misc]
        cls._Numbers.__qualname__ = f"{cls.__qualname__}._Numbers"

    @property
    def numbers(self) -> Self:
        """The settings and properties that are numbers: compiled functions take them for these."""
        kind = self._Numbers
        return cast(Self, kind._make(getattr(self, name) for name in kind._fields))

    def __post_init__(self) -> None:
        check_fields(self, f"{section_name(type(self))}.", ConfigError)

    def ordered(self, *names: str) -> None:
        """Raise ConfigError unless each named field is at most as large as the next one."""
        values = [getattr(self, name) for name in names]
        if values != sorted(values):
            raise ConfigError(
                f"{section_name(type(self))}: {' <= '.join(names)} must hold, "
                f"but they are {', '.join(map(str, values))}."
            )
