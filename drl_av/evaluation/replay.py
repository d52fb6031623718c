"""Drives episodes again: recordings exactly, and the worst of a table, drawn on one sheet."""

import io
import math
import re
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from PIL import Image

from drl_av.config import Config
from drl_av.config.section import did_you_mean
from drl_av.drawing.page import PageEpisode
from drl_av.drawing.panels import Caption
from drl_av.drawing.picture import Picture, draw
from drl_av.drivers.checked import SteadyDriver
from drl_av.drivers.driver import Driver
from drl_av.drivers.learned import LearnedDriver, MaskedPolicyDriver
from drl_av.drivers.registry import DriverSpec, find_drivers
from drl_av.drivers.rule_based import SumoDriver
from drl_av.env.custom import NOTHING_CUSTOM, CustomParts
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeResult, leader
from drl_av.env.renderer import next_caption
from drl_av.env.rollout import Watcher, drive
from drl_av.env.transition import Transition
from drl_av.errors import ConfigError, RecordingError, ScenarioError, printable
from drl_av.evaluation import PROVENANCE
from drl_av.evaluation.episodes import drivers_in
from drl_av.evaluation.provenance import read_provenance
from drl_av.evaluation.recording import Follower, RecordedDriver, Recording, recording_of
from drl_av.evaluation.table import read_results, report_corrupt_table, stored_config
from drl_av.road.road import Road
from drl_av.safety.paper import closing_speed, time_to_collision
from drl_av.scenarios.folder import find_scenario, load_scenario, shipped_scenarios, with_scenario
from drl_av.simulation.sumo_options import option_words

FCD_OPTIONS = (
    *("--fcd-output.attributes", "x,y,angle,type,speed,pos,lane,acceleration,posLat,speedLat"),
    *("--precision", "6"),
)
"""The options of SUMO's floating car data, beside the name of its file."""


def require_fcd_alone(sumo_options: str | Sequence[str]) -> None:
    """Raise ConfigError if options of the user change the file of SUMO's floating car data."""
    ours = {"--fcd-output", "--output-prefix", *FCD_OPTIONS[::2]}
    if taken := [word for word in option_words(sumo_options) if word in ours]:
        raise ConfigError(f"--fcd does not go with {taken[0]} in sumo_options: leave one out.")


class Pacer:
    """Slows an episode in sumo-gui to ``rate`` times real time: a decision takes 1 / rate s."""

    def __init__(self, rate: float) -> None:
        self._pause_s = 1.0 / rate
        self._due_s: float | None = None

    def __call__(self, decision: Transition) -> None:
        """Wait until this decision has been shown for 1 / rate seconds."""
        now = time.monotonic()
        last_s = now if self._due_s is None else self._due_s
        self._due_s = max(now, last_s + self._pause_s)
        time.sleep(self._due_s - now)


def page_episode(session: "ReplaySession", decisions: Sequence[Transition]) -> PageEpisode:
    """Return an episode of a session for a page, with the values of a learned driver."""
    driver = session.driver.inner if isinstance(session.driver, SteadyDriver) else session.driver
    are = "Probabilities" if isinstance(driver, MaskedPolicyDriver) else "Q-values"
    shots = [decisions[0].scene.snapshot, *(made.next_scene.snapshot for made in decisions)]
    found = [
        {
            "proposed": made.proposed.number,
            "executed": made.executed.number,
            "rule": str(made.rule),
            "reward": made.reward,
            **made.terms._asdict(),
            "values": _values(driver, made),
            "changes_lane": _begins_lane_change(made),
            "collision": None if made.collision is None else made.collision.kind.value,
        }
        for made in decisions
    ]
    title = f"{session.name}, seed {session.seed}"
    return PageEpisode(title, session.facts, are, shots, found)


def _values(driver: Driver, decision: Transition) -> list[float] | None:
    match driver:
        case LearnedDriver():
            values = driver.values(decision.observation)
        case MaskedPolicyDriver():
            values = driver.probabilities(decision.scene)
        case _:
            return None
    return [float(value) for value in values]


def _begins_lane_change(decision: Transition) -> bool:
    before, after = decision.scene, decision.next_scene
    return after.lane_change is not None and {*before.lanes} != {*after.lanes}


@dataclass(frozen=True)
class ReplaySession:
    """An episode to show: settings, driver and traffic; or a recording to repeat exactly."""

    config: Config
    driver: Driver
    name: str
    seed: int
    vehicles: int
    """Number of vehicles around the ego."""
    recording: Recording | None = None
    """The recording that the episode must repeat exactly; None for a new episode."""
    custom: CustomParts = NOTHING_CUSTOM
    """The user's own check, reward and observation."""
    expected: EpisodeResult | None = None
    """The row of a table that the episode must repeat exactly; None for another episode."""

    @property
    def road(self) -> Road:
        """The road of the episode's scenario."""
        return load_scenario(find_scenario(self.config.simulation.scenario)).road

    @property
    def facts(self) -> str:
        """The safety check, the scenario without its folders, and the world in words."""
        own, settings = self.custom.safety_check, self.config.simulation
        check = self.config.safety.check if own is None or not isinstance(own, str) else own
        check = "none" if isinstance(self.driver, SumoDriver) else check
        road = Path(settings.scenario).name
        return f"safety check: {check}; scenario: {road}; world: {settings.world}"

    def with_options(self, *words: str) -> "ReplaySession":
        """Return the session with further options of SUMO."""
        own = *option_words(self.custom.sumo_options), *words
        return replace(self, custom=self.custom._replace(sumo_options=own))

    def drive(self, render_mode: str | None, *watchers: Watcher) -> tuple[Recording, EpisodeResult]:
        """Drive the episode, and call each watcher with each decision.

        Returns:
            The recording of the episode, and its result.

        Raises:
            RecordingError: the episode differs from the recording or row that it must repeat.
        """
        follower = None if self.recording is None else Follower(self.recording)
        decisions = list[Transition]()
        watching = decisions.append, *([] if follower is None else [follower.add]), *watchers
        made = HighwayEnv(config=self.config, render_mode=render_mode, **self.custom._asdict())
        with closing(made) as env:
            given = self.driver, self.name, self.seed, self.vehicles
            result = drive(env, *given, watchers=watching)
            if follower is not None:
                follower.end()
        made_row = result.cells()
        if self.expected is not None and not made_row.items() <= self.expected.cells().items():
            raise RecordingError(
                f"The episode with seed {self.seed} differs from its row: the table was made with "
                "another driver, scenario or own part, another version, or on another platform."
            )
        return recording_of(decisions, env, self.name, self.seed), result


def replay_session(recording: Recording, custom: CustomParts = NOTHING_CUSTOM) -> ReplaySession:
    """Return the session that repeats a recorded episode exactly."""
    model = recording.ego_model
    driver = RecordedDriver(recording) if model is None else SumoDriver(model)
    return ReplaySession(
        recording.config,
        driver,
        recording.driver,
        recording.seed,
        recording.vehicles,
        recording,
        custom,
    )


def on_its_road(config: Config, source: Path | str, scenario: str | None) -> Config:
    """Return the config of recorded episodes with the folder in which their road is now.

    ``scenario`` names it if it was moved; that it is another road, the replay finds out.

    Raises:
        RecordingError: the road is not where it was, or ``scenario`` is named although it ships.
    """
    was = config.simulation.scenario
    if scenario is None:
        try:
            find_scenario(was)
        except ScenarioError as error:
            raise RecordingError(
                f"{source} was driven on the road {was}, which is no longer there: name the folder "
                "in which it is now with --scenario, or put the folder back there."
            ) from error
        return config
    if was in shipped_scenarios():
        raise RecordingError(
            f"--scenario cannot be changed in {source}, whose scenario {was} ships: leave it out."
        )
    return with_scenario(config, scenario)


def require_same_traffic(sessions: Sequence[ReplaySession]) -> None:
    """Raise RecordingError unless these episodes meet the same traffic on the same road."""
    configs = [one.config.without_training for one in sessions]
    roads = [(one.simulation, one.traffic) for one in configs]
    met = [(one.seed, one.vehicles, road) for one, road in zip(sessions, roads, strict=True)]
    if any(each != met[0] for each in met):
        raise RecordingError(
            "These recordings are of other traffic or another road, so that one page would compare "
            "nothing: record both with the same --seed, --vehicles, --scenario, --traffic and "
            "--world."
        )


LOW_IS_WORSE = ("min_", "mean_speed", "mean_r", "comfortable")
"""How the columns begin whose smallest value is the worst."""
NEARNESS = ("min_ttc_s", "min_headway_s", "min_pet_s", "max_drac_m_s2")
"""The columns that measure how near a collision was."""
ON_A_SHEET = 10
TILE = (640, 360)
"""Width and height of a picture on the sheet, px."""


def worst_sessions(
    table: Path,
    column: str,
    word: str | None,
    custom: CustomParts,
    scenario: str | None,
    count: int,
) -> list[ReplaySession]:
    """Return the sessions that drive the ``count`` worst episodes of a table again.

    ``column`` is the column whose value makes an episode bad; in those of ``NEARNESS``, which are
    measured after each decision, a collision is worse than any near miss. ``word`` names a driver
    as on the command line; only its episodes count then. ``custom`` holds the user's parts, and
    ``scenario`` is the folder of the table's road if it was moved.

    Raises:
        ConfigError: there is no such column, no episode of the driver ``word``, or the driver of an
            episode cannot be found.
        DrlAvError: the table or the provenance beside it is missing or damaged.
    """
    results = read_results(table)
    with report_corrupt_table(table):
        facts = read_provenance(table, PROVENANCE)
        config = stored_config(facts["settings"], table.with_suffix(PROVENANCE).name)
    for name, was in facts.get("custom", {}).items():
        if was and name in CustomParts._fields and name not in custom.words():
            its, option = re.sub(" [0-9a-f]{64}$", "", was), f"--{name.replace('_', '-')}"
            raise ConfigError(f"{table} was made with {option} {its}: give it again.")
    config = on_its_road(config, table, scenario)
    numbers = [name for name, value in vars(results[0]).items() if not isinstance(value, str)]
    if column not in numbers:
        raise ConfigError(
            f"{table} has no numbers in a column {column!r}{did_you_mean(column, numbers)}: name "
            f"one of: {', '.join(numbers)}."
        )
    sign = 1.0 if column.startswith(LOW_IS_WORSE) else -1.0

    def badness(row: EpisodeResult) -> tuple[bool, float]:
        return not (row.collided and column in NEARNESS), sign * getattr(row, column)

    given = _given(word, table, [*dict.fromkeys(row.driver for row in results)])
    chosen = [row for row in results if word is None or row.driver in given]
    if len({*map(badness, chosen)}) == 1 and len(chosen) > count:
        raise ConfigError(f"All {len(chosen)} episodes have the same {column}: name another one.")
    worst = sorted(chosen, key=badness)[:count]
    specs = _specs({row.driver: row.group for row in worst}, given)
    with closing(HighwayEnv(config=config, **custom._asdict())) as env:
        drivers = drivers_in(env, custom, list(specs.values()))
    sessions = []
    for row in worst:
        spec = specs[row.driver]
        own = custom.beside(spec.under)
        driven = spec.config(config), drivers[row.driver], row.driver, row.seed, row.vehicles
        sessions.append(ReplaySession(*driven, custom=own, expected=row))
    return sessions


def _given(word: str | None, table: Path, names: Sequence[str]) -> dict[str, DriverSpec]:
    """Return the drivers that ``word`` names, by their names in the table, which are ``names``."""
    if word is None:
        return {}
    try:
        given = {spec.name: spec for spec in find_drivers([word])}
    except ConfigError as error:
        if printable(word) not in names:
            raise
        raise ConfigError(
            f"{error.args[0][:-1]}: {word} is the table's name of a run, so name its folder or "
            "file, or of a group 'GROUP=PATTERN'."
        ) from error
    if (whole := printable(word)) in names:  # such as a path, beside another with the same end
        given = {whole: find_drivers([word])[0]}
    if not given.keys() & set(names):
        raise ConfigError(
            f"{table} has no episodes of the driver {word!r}{did_you_mean(word, names)}: name one "
            f"of: {', '.join(names)}."
        )
    return given


def _specs(groups: Mapping[str, str], given: Mapping[str, DriverSpec]) -> dict[str, DriverSpec]:
    """Return the drivers of a table by name, those that are ``given`` among them.

    ``groups`` has the name of each driver's group; "" or the driver's name if it is in none.
    """
    found = {}
    for name, group in groups.items():
        try:
            spec = given[name] if name in given else find_drivers([name])[0]
        except ConfigError as error:
            how = "name its folder or file with --driver"
            if group not in ("", name):
                how = f"name the group as in the evaluation, --driver '{group}=PATTERN'"
            raise ConfigError(f"{error.args[0][:-1]}: {how}.") from error
        found[name] = replace(spec, name=name)
    return found


def critical_picture(decisions: Sequence[Transition], caption: Caption, road: Road) -> Picture:
    """Draw the collision of an episode, or its smallest time to collision, as a ``TILE``.

    ``caption`` is that of its beginning. There must be a decision.
    """

    def nearness(decision: Transition) -> tuple[bool, float]:
        front = leader(decision.next_scene)
        ttc_s = math.inf if front is None else time_to_collision(front.gap_m, closing_speed(front))
        return decision.collision is None, ttc_s

    nearest = min(decisions, key=nearness)
    for decision in decisions:
        caption = next_caption(caption, decision, road)
        if decision is nearest:
            break
    return draw(nearest.next_scene.snapshot, road, caption, TILE)


def contact_sheet(sessions: Sequence[ReplaySession], column: str) -> bytes:
    """Drive the sessions; return a PNG file with the critical moment of each, two in a row.

    Raises:
        RecordingError: an episode differs from its row in the table.
    """
    width, height = TILE
    sheet = Image.new("RGB", (2 * width, height * math.ceil(len(sessions) / 2)))
    for place, session in enumerate(sessions):
        value = getattr(session.expected, column)
        title = f"{session.name}, {column} {value:.3g}"
        decisions = list[Transition]()
        session.drive(None, decisions.append)
        begin = Caption(driver=title, seed=session.seed)
        tile = critical_picture(decisions, begin, session.road)
        sheet.paste(Image.fromarray(tile), (width * (place % 2), height * (place // 2)))
    data = io.BytesIO()
    sheet.save(data, "PNG")
    return data.getvalue()
