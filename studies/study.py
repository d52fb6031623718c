"""A study as data: drivers, settings, numbers of vehicles and seeds in one TOML file."""

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.config.section import did_you_mean
from drl_av.drivers.policy_file import find_policy
from drl_av.drivers.registry import find_drivers
from drl_av.env.episode_start import TRAINING_SEED_RANGE
from drl_av.env.metrics import EpisodeMetrics
from drl_av.errors import ConfigError
from drl_av.evaluation.criticality import CriticalityMetrics
from drl_av.evaluation.provenance import checksum
from drl_av.evaluation.table import Inputs
from drl_av.files.table import Row
from studies.engine import EpisodeCell
from studies.options import Options, Plan, Settings, order_by, settings_of
from studies.trainings import TrainingJob

if TYPE_CHECKING:
    from matplotlib.figure import Figure

METRICS: Mapping[str, type[EpisodeMetrics]] = {
    "episode": EpisodeMetrics,
    "criticality": CriticalityMetrics,
}
MEASURES = {"mean", "interval", "total", "text", "iqm", "improvement", "gain", "change"}
"""The kinds of measures of a table (``studies.pivot``)."""
KEYS: Mapping[str, Mapping[str, type]] = {
    "": dict.fromkeys(("meaning", "row", "settings_named", "metrics"), str)
    | dict.fromkeys(("settings", "rows", "variants", "trainings", "tables", "figures"), dict)
    | dict.fromkeys(("columns", "order"), list),
    "rows": {"drivers": list, "traffic": list, "vehicles": list, "seeds": dict},
    "seeds": {"first": int, "count": int},
    "variants": {"drivers": list, "vehicles": list, "episodes": int, "label": str, "trained": bool}
    | dict.fromkeys(("columns", "settings"), dict),
    "trainings": dict.fromkeys(("base", "folder", "name", "label"), str)
    | {"settings": dict, "seeds": dict, "traffic": list, "stop": int},
    "tables": dict.fromkeys(("columns", "units", "best", "slowest", "text"), str)
    | dict.fromkeys(("rows", "heads", "ours", "measures", "from"), list)
    | dict.fromkeys(("where", "without", "value", "pool", "total"), dict),
    "measures": dict.fromkeys(("head", *MEASURES), str)
    | {"digits": int, "common": bool, "of": dict, "over": object},
}
"""The type of each key of each part of a study's file."""
ELEMENTS: Mapping[str, type] = {"drivers": str, "traffic": str, "vehicles": int}
"""The type of the elements of these lists."""
NEEDED = {"": ("meaning", "rows"), "rows": ("seeds",), "seeds": ("count",), "trainings": ("base",)}
"""The keys that a part must have."""
TYPES = {
    str: "a text",
    int: "a whole number",
    bool: "true or false",
    list: "a list",
    dict: "a table",
}


class Variant(NamedTuple):
    """The drivers that drive with the same settings."""

    name: str
    drivers: tuple[str, ...]
    vehicles: tuple[int, ...]
    episodes: int
    columns: Row
    """Columns in which the rows of the variant have the same value."""
    settings: Settings
    label: str
    """The label of a driver in tables; "{driver}" stands for its name."""
    trained: bool
    """Whether the drivers that the study trains drive with this variant, too."""


class Trained(NamedTuple):
    """A driver that the study trains."""

    name: str
    """Its name in the table."""
    label: str
    """Its label in tables; "{count}" stands for the number of drivers of this kind."""
    job: TrainingJob


@dataclass(frozen=True, eq=False)
class FileStudy:
    """A study that a TOML file describes (see ``studies.options.Program``).

    Raises ConfigError if the file has an unknown key.
    """

    path: Path

    @cached_property
    def file(self) -> Mapping[str, Any]:
        """The content of the file."""
        try:
            content = tomllib.loads(self.path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise ConfigError(f"{self.path} is not valid TOML: {error}.") from error
        rows = _checked(self.path, "", content)["rows"]
        seeds = _checked(self.path, "seeds", _checked(self.path, "rows", rows)["seeds"])
        first = seeds.get("first", 0)
        if not 0 <= first < first + seeds["count"] <= TRAINING_SEED_RANGE[0]:
            raise ConfigError(
                f"{self.path} has the seeds from {first} to {first + seeds['count'] - 1}: name one "
                f"or more of 0 to {TRAINING_SEED_RANGE[0] - 1}, which no training drives."
            )
        if content.get("metrics", "episode") not in METRICS:
            raise ConfigError(f"{self.path}: metrics must be one of {', '.join(METRICS)}.")
        for part in ("variants", "trainings", "tables"):
            for each in content.get(part, {}).values():
                _checked(self.path, part, each)
                for one in (*each.get("measures", ()), *filter(None, [each.get("value")])):
                    if len(_checked(self.path, "measures", one).keys() & MEASURES) != 1:
                        raise ConfigError(
                            f"{self.path} has the measure {one}: it must have one of the keys "
                            f"{', '.join(sorted(MEASURES))}."
                        )
        return content

    @property
    def name(self) -> str:
        """Name of the file and of the results, without its ending."""
        return self.path.stem

    @property
    def meaning(self) -> str:
        """What the study holds, in one sentence."""
        return str(self.file["meaning"])

    @property
    def row(self) -> str:
        """The meaning of a row."""
        return str(self.file.get("row", "an episode"))

    @property
    def vehicles(self) -> tuple[int, ...]:
        """All numbers of vehicles, in ascending order."""
        variants = (each.get("vehicles", []) for each in self.file.get("variants", {}).values())
        own = self.file["rows"].get("vehicles", [])
        return tuple(sorted({*own, *(number for each in variants for number in each)}))

    @cached_property
    def variants(self) -> Sequence[Variant]:
        """The variants; a study without any has one, which is called ""."""
        rows = self.file["rows"]
        return [
            Variant(
                name,
                tuple(dict.fromkeys(own.get("drivers", rows.get("drivers", ())))),
                tuple(own.get("vehicles", rows.get("vehicles", ()))),
                own.get("episodes", rows["seeds"]["count"]),
                own.get("columns", {}),
                own.get("settings", {}),
                own.get("label", "`{driver}`"),
                own.get("trained", True),
            )
            for name, own in self.file.get("variants", {"": {}}).items()
        ]

    @property
    def drivers(self) -> list[str]:
        """All drivers that exist already, in the order of the file."""
        names = [*self.file["rows"].get("drivers", ())]
        return list(dict.fromkeys([*names, *(n for each in self.variants for n in each.drivers)]))

    def trained(self, options: Options) -> list[Trained]:
        """Return the drivers that the study trains, in the order of the file."""
        found = []
        for template, own in self.file.get("trainings", {}).items():
            base = _training_base(own["base"])
            first, count = own.get("seeds", {}).get("first", 0), own.get("seeds", {}).get("count")
            seeds = [None] if count is None else [*range(first, first + options.trainings(count))]
            for seed in seeds:
                for kind in own.get("traffic", [None]):
                    its: Settings = {} if seed is None else {"learning": {"seed": seed}}
                    config = options.settings(base, own.get("settings", {}), _traffic(kind), its)
                    words = {"seed": seed, "traffic": kind}
                    folder = options.runs / own.get("folder", template).format(**words)
                    stop = min(own.get("stop", config.learning.episodes), config.learning.episodes)
                    every = config.learning.evaluate_every
                    job = TrainingJob(template.partition("-")[0], config, stop, folder, every)
                    name = own.get("name", template).format(**words)
                    label = own.get("label", "`{name}`")
                    label = label.format(name=name, count="{count}", **words)
                    found.append(Trained(name, label, job))
        return found

    def base(self, drivers: Iterable[str], options: Options) -> Config:
        """Return the study's settings for ``drivers``, without those of a variant."""
        learned = [name for name in drivers if name.startswith("pretrained")]
        learned = learned or [name for name in self.drivers if name.startswith("pretrained")]
        return options.settings(settings_of(learned), self.file.get("settings", {}))

    def plan(self, options: Options) -> Plan:
        """Return what must be trained and driven."""
        trained = self.trained(options)
        settings: dict[str, Config] = {}
        cells = list(self._cells(trained, options, settings))
        policies = {
            name: checksum(find_policy(each.run))
            for name, each in zip(self.drivers, find_drivers(self.drivers), strict=True)
            if each.run
        }
        inputs = Inputs(settings, policies, {each.name: each.job.stop for each in trained})
        return Plan(inputs, self._place(trained), cells=cells)

    def _cells(
        self, trained: Sequence[Trained], options: Options, settings: dict[str, Config]
    ) -> Iterator[EpisodeCell]:
        rows, template = self.file["rows"], self.file.get("settings_named", "")
        metrics = METRICS[self.file.get("metrics", "episode")]
        columns, first = tuple(self.file.get("columns", ["*"])), rows["seeds"].get("first", 0)
        groups: list[tuple[Variant, tuple[str, ...], Trained | None]] = [
            (variant, variant.drivers, None) for variant in self.variants if variant.drivers
        ]
        groups += [
            (variant, (str(each.job.folder),), each)
            for each in trained
            for variant in self.variants
            if variant.trained
        ]
        for variant, drivers, made in groups:
            job, trained_name = (made.job, made.name) if made else (None, "")
            base = made.job.config if made else self.base(drivers, options)
            for kind in rows.get("traffic", [None]):
                own = self.file.get("settings", {}), _traffic(kind), variant.settings
                config = options.settings(base, *own)
                for name in [made.name] if made else drivers:
                    words = {"driver": name, "training": name, "traffic": kind}
                    varies = "{traffic}" in template or "{variant}" in template
                    settings.setdefault(
                        template.format(**words, variant=variant.name), config if varies else base
                    )
                key = {} if kind is None else {"traffic": kind}
                key |= {"variant": variant.name} if variant.name else {}
                seeds = range(first, first + options.episodes(variant.episodes))
                common = [n for n in variant.vehicles if n in options.vehicles(self.vehicles)]
                for number in common or options.vehicles(variant.vehicles):
                    where = config, drivers, number, seeds, columns, {**key, **variant.columns}
                    yield EpisodeCell(*where, job, trained_name, metrics)

    def _place(self, trained: Sequence[Trained]) -> Callable[[Row], tuple[Any, ...]]:
        names = [*self.drivers, *(each.name for each in self.trained(Options()))]
        names += [each.name for each in trained if each.name not in names]
        known: dict[str, Iterable[object] | Callable[[str], Any]] = {
            "driver": names,
            "training": names,
            "variant": [each.name for each in self.variants],
            "vehicles": self.vehicles,
            "traffic": self.file["rows"].get("traffic", ()),
            "seed": int,
        }
        for column in {name for each in self.variants for name in each.columns}:
            found = (each.columns[column] for each in self.variants if column in each.columns)
            known[column] = dict.fromkeys(found)
        order = self.file.get("order", ["vehicles", "seed", "driver"])
        if others := [column for column in order if column not in known]:
            words = ", ".join(known)
            raise ConfigError(f"{self.path}: order has {others[0]!r}, but must be of {words}.")
        return order_by(**{column: known[column] for column in order})

    @property
    def derived(self) -> Mapping[str, Callable[[list[Row]], list[Row]]]:
        """No further tables."""
        return {}

    @property
    def tables(self) -> Mapping[str, Callable[[Path], str]]:
        """The Markdown tables, by name."""
        from studies.pivot import markdown

        return {
            name: partial(markdown, self, spec)
            for name, spec in self.file.get("tables", {}).items()
        }

    @property
    def figures(self) -> "Mapping[str, Callable[[Path], Figure]]":
        """The figures, by name."""
        from studies.plot import figure

        return {
            name: partial(figure, self, spec) for name, spec in self.file.get("figures", {}).items()
        }


def _traffic(kind: str | None) -> Settings:
    return {} if kind is None else {"traffic": {"kind": kind}}


def _training_base(name: str) -> Config:
    """Return the settings of the shipped driver ``name``, or those of the preset ``name``."""
    return settings_of([name]) if name.startswith("pretrained") else preset(name)


def _checked(path: Path, part: str, content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a part of a study's file; raise ConfigError if it has not the keys that it may."""
    if not isinstance(content, dict):
        raise ConfigError(f"{path} has {content!r} among its {part}: write a table.")
    for name in (*NEEDED.get(part, ()), *content):
        if name not in KEYS[part]:
            hint = did_you_mean(name, KEYS[part])
            raise ConfigError(f"{path} has an unknown key {name!r}{hint}: remove or correct it.")
        value, kind = content.get(name), KEYS[part][name]
        if name in ELEMENTS and isinstance(value, list):
            kind = ELEMENTS[name]
            value = next((each for each in value if type(each) is not kind), kind())
        if kind is not object and type(value) is not kind:
            said = f"is {value!r}" if name in content else "is missing"
            raise ConfigError(f"{path}: {name} {said}, but must be {TYPES[kind]}.")
    return content
