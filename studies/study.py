"""A study as data: drivers, settings, numbers of vehicles and seeds in one TOML file."""

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.config.section import did_you_mean
from drl_av.drivers.registry import find_drivers
from drl_av.env.episode_start import TRAINING_SEED_RANGE
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.errors import ConfigError, DrlAvError
from drl_av.evaluation.criticality import CriticalityMetrics, CriticalityResult
from drl_av.evaluation.table import Inputs, checksums
from drl_av.files.atomic import files_digest
from drl_av.files.table import Row
from drl_av.scenarios.folder import find_scenario
from studies.engine import EpisodeCell
from studies.options import FOLDER, Options, Plan, Settings, order_by, settings_of
from studies.trainings import TrainingJob

if TYPE_CHECKING:
    from matplotlib.figure import Figure

METRICS: Mapping[str, tuple[type[EpisodeMetrics], type[EpisodeResult]]] = {
    "episode": (EpisodeMetrics, EpisodeResult),
    "criticality": (CriticalityMetrics, CriticalityResult),
}
"""The metrics of an episode by name, and the fields that they have."""
MEASURES = {"mean", "interval", "total", "text", "iqm", "improvement", "gain", "change"}
"""The kinds of measures of a table (``studies.pivot``)."""
COMPARED = {"improvement", "gain", "change"}
"""Those that compare rows with others."""
KEYS: Mapping[str, Mapping[str, type]] = {
    "": dict.fromkeys(("meaning", "row", "metrics"), str)
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
    "figures": dict.fromkeys(("along", "panels", "title", "units"), str)
    | dict.fromkeys(("labels", "from", "ours"), list)
    | dict.fromkeys(("where", "without", "value"), dict)
    | {"x": object, "line": bool},
    "measures": dict.fromkeys(("head", *MEASURES), str)
    | {"digits": int, "common": bool, "of": dict, "over": object},
}
"""The type of each key of each part of a study's file."""
ELEMENTS: Mapping[str, type] = {"drivers": str, "traffic": str, "vehicles": int}
"""The type of the elements of these lists."""
NEEDED = {"": ("meaning", "rows"), "rows": ("seeds",), "seeds": ("count",)}
NEEDED |= {"trainings": ("base",), "figures": ("x", "value", "labels")}
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
        if content.get("metrics", "episode") not in METRICS:
            raise ConfigError(f"{self.path}: metrics must be one of {', '.join(METRICS)}.")
        for part in ("variants", "trainings", "tables", "figures"):
            for each in _single(content.get(part, {}).values()):
                _checked(self.path, part, each)
                own = _checked(self.path, "seeds", each.get("seeds", {"count": 1}))
                if own["count"] < 1:
                    raise ConfigError(f"{self.path} has a training with {own['count']} seeds.")
                if (
                    part == "tables"
                    and each.get("rows")
                    and ("value" in each) != ("columns" in each)
                ):
                    raise ConfigError(
                        f"{self.path} has a table with one of value and columns, which belong "
                        "together: name both, or a measure."
                    )
                measures = each.get("measures", ()), each.get("value"), each.get("x")
                for one in (*measures[0], *(m for m in measures[1:] if isinstance(m, dict))):
                    kinds = _checked(self.path, "measures", one).keys() & MEASURES
                    if len(kinds) != 1:
                        raise ConfigError(
                            f"{self.path} has the measure {one}: it must have one of the keys "
                            f"{', '.join(sorted(MEASURES))}."
                        )
                    if kinds & COMPARED and not one.keys() & {"over", "of"}:
                        raise ConfigError(
                            f"{self.path} has the measure {one}: it must name with over (or of) "
                            "what the rows are compared to."
                        )
                    if any(one is each for each in measures[0]) and "head" not in one:
                        raise ConfigError(f"{self.path} has the measure {one}: give it a head.")
        first, variants = seeds.get("first", 0), content.get("variants", {}).values()
        for count in (seeds["count"], *(v["episodes"] for v in variants if "episodes" in v)):
            if not 0 <= first < first + count <= TRAINING_SEED_RANGE[0]:
                raise ConfigError(
                    f"{self.path} has the seeds from {first} to {first + count - 1}: name one or "
                    f"more of 0 to {TRAINING_SEED_RANGE[0] - 1}, which no training drives."
                )
        return content

    @property
    def name(self) -> str:
        """Name of the file and of the results, without its ending."""
        return self.path.stem

    @property
    def word(self) -> str:
        """What names the study after ``python -m studies``."""
        return self.name if self.path.parent == FOLDER else str(self.path)

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
                tuple(dict.fromkeys(own.get("vehicles", rows.get("vehicles", ())))),
                own.get("episodes", rows["seeds"]["count"]),
                {name: str(value) for name, value in own.get("columns", {}).items()},
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
        """Return the drivers that the study trains, in the order of the file.

        Raises ConfigError if one is no training by Algorithm 1, or two have the same folder.
        """
        found: list[Trained] = []
        for template, own in self.file.get("trainings", {}).items():
            base = _training_base(own["base"])
            first, count = own.get("seeds", {}).get("first", 0), own.get("seeds", {}).get("count")
            seeds = [None] if count is None else [*range(first, first + options.trainings(count))]
            for seed in seeds:
                for kind in own.get("traffic", [None]):
                    its: Settings = {} if seed is None else {"learning": {"seed": seed}}
                    config = options.settings(base, own.get("settings", {}), _traffic(kind), its)
                    words = {"seed": seed, "traffic": kind}
                    folder = options.runs / self.filled(own.get("folder", template), **words)
                    if config.learning.algorithm == "ppo":
                        raise ConfigError(
                            f"{self.path}: {template} trains by PPO, but a study by Algorithm 1: "
                            "name the folder of a run of drl-av train among the drivers."
                        )
                    if any(each.job.folder == folder for each in found):
                        raise ConfigError(
                            f"{self.path}: {template} names several trainings {folder.name}: write "
                            "{seed} or {traffic} into its name, whichever varies."
                        )
                    stop = min(own.get("stop", config.learning.episodes), config.learning.episodes)
                    every = config.learning.evaluate_every
                    job = TrainingJob(template.partition("-")[0], config, stop, folder, every)
                    name = self.filled(own.get("name", template), **words)
                    label = own.get("label", "`{name}`")
                    label = self.filled(label, name=name, count="{count}", **words)
                    found.append(Trained(name, label, job))
        return found

    def base(self, drivers: Iterable[str], options: Options) -> Config:
        """Return the study's settings for ``drivers``, without those of a variant."""
        return options.settings(
            settings_of([*drivers, *self.drivers]), self.file.get("settings", {})
        )

    def plan(self, options: Options) -> Plan:
        """Return what must be trained and driven.

        Raises ConfigError if there is nothing, or the table would not tell its rows apart.
        """
        trained, specs = self.trained(options), find_drivers(self.drivers)
        if group := next((each.group for each in specs if each.group), None):
            raise ConfigError(f"{self.path}: drivers has the group {group}: name its trainings.")
        settings: dict[str, Config] = {}
        cells, place = list(self._cells(trained, options, settings)), self._place(trained)
        if not cells:
            raise ConfigError(f"{self.path} drives nothing: name drivers and vehicles in [rows].")
        _, result = METRICS[self.file.get("metrics", "episode")]
        own = {each.name: each for each in fields(result)}
        for lacks in ({*self.columns, *self.order} - {"*", *own, *c.row("", 0)} for c in cells):
            if lacks:
                hint = did_you_mean(name := min(lacks), own)
                raise ConfigError(
                    f"{self.path}: an episode lacks the column {name!r}{hint}: correct or remove "
                    "it, or give it to each variant."
                )
        begun = [place(c.row(d, seed)) for c in cells for d in c.drivers for seed in c.seeds[:2]]
        if len({*begun}) < len(begun):
            raise ConfigError(
                f"{self.path} has rows that order does not tell apart: add vehicles, seed, driver, "
                "traffic, variant or a column of the variants to order and columns."
            )
        scenarios = {config.simulation.scenario for config in settings.values()}
        files = {f"scenario {name}": files_digest(find_scenario(name)) for name in scenarios}
        stops = {each.name: each.job.stop for each in trained}
        return Plan(Inputs(settings, checksums(specs), stops, files), place, cells=cells)

    @property
    def columns(self) -> list[str]:
        """The columns of the table; "*" stands for all fields of an episode."""
        return list(self.file.get("columns", [*self._varying, "*"]))

    @property
    def order(self) -> list[str]:
        """The columns by which the rows are sorted."""
        return list(self.file.get("order", [*self._varying, "vehicles", "seed", "driver"]))

    @property
    def _varying(self) -> list[str]:
        """The columns beside the number of vehicles, seed and driver in which rows may differ."""
        kinds = ["traffic"] if "traffic" in self.file["rows"] else []
        return kinds + (["variant"] if "variants" in self.file else [])

    def filled(self, template: str, **words: object) -> str:
        """Return a text of the file with its braces replaced."""
        try:
            return template.format(**words)
        except (LookupError, ValueError, AttributeError) as error:
            known = ", ".join(f"{{{word}}}" for word in words)
            raise ConfigError(
                f"{self.path}: {template!r} may have {known} in braces, but nothing else."
            ) from error

    def _cells(
        self, trained: Sequence[Trained], options: Options, settings: dict[str, Config]
    ) -> Iterator[EpisodeCell]:
        rows = self.file["rows"]
        metrics, _ = METRICS[self.file.get("metrics", "episode")]
        columns, first = tuple(self.columns), rows["seeds"].get("first", 0)
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
            for kind in dict.fromkeys(rows.get("traffic", [None])):
                own = self.file.get("settings", {}), _traffic(kind), variant.settings
                config = options.settings(base, *own)
                if made:
                    settings[made.name] = made.job.config
                where_driven = [kind, variant.name]
                if made and not any(where_driven) and config != made.job.config:
                    where_driven = ["driving"]
                settings[", ".join(filter(None, [trained_name, *where_driven]))] = config
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
        if others := [column for column in self.order if column not in known]:
            words = ", ".join(known)
            raise ConfigError(f"{self.path}: order has {others[0]!r}, but must be of {words}.")
        usual = {"vehicles", "seed", "driver"} if "*" in self.columns else set()
        if others := [name for name in self.order if name not in {*self.columns, *usual}]:
            raise ConfigError(f"{self.path}: order has {others[0]!r}, which columns lacks: add it.")
        return order_by(**{column: known[column] for column in self.order})

    @property
    def derived(self) -> Mapping[str, Callable[[list[Row]], list[Row]]]:
        """No further tables."""
        return {}

    @property
    def tables(self) -> Mapping[str, Callable[[Path], str]]:
        """The Markdown tables, by name."""
        from studies.pivot import markdown

        return {
            name: partial(self._shown, f"table {name}", markdown, spec)
            for name, spec in self.file.get("tables", {}).items()
        }

    @property
    def figures(self) -> "Mapping[str, Callable[[Path], Figure]]":
        """The figures, by name."""
        from studies.plot import figure

        return {
            name: partial(self._shown, f"figure {name}", figure, spec)
            for name, spec in self.file.get("figures", {}).items()
        }

    def _shown(self, what: str, make: Callable[..., Any], spec: Any, folder: Path) -> Any:
        """Return the table or figure of a specification; raise ConfigError if it is wrong."""
        try:
            return make(self, spec, folder)
        except DrlAvError:
            raise
        except Exception as error:  # pandas raises many kinds for what a file says
            why = f"it names {error}, which is not there" if isinstance(error, KeyError) else error
            raise ConfigError(
                f"{self.path}: the {what} cannot be made ({why}): correct it there; the rows in "
                f"{folder / self.name}.csv are kept."
            ) from error


def _single(parts: Iterable[Any]) -> list[Any]:
    """Return the parts, those of a list each for itself."""
    return [one for part in parts for one in (part if isinstance(part, list) else [part])]


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
