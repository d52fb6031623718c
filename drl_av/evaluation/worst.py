"""The worst episodes of a table of ``drl-av evaluate``: driven again, and drawn on one sheet."""

import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from PIL import Image

from drl_av.config.schema import did_you_mean
from drl_av.drawing.panels import Caption
from drl_av.drawing.picture import Picture, draw
from drl_av.drivers.registry import DriverSpec, find_drivers, make_drivers
from drl_av.env.custom import CustomParts, custom_check
from drl_av.env.metrics import EpisodeResult
from drl_av.env.renderer import next_caption
from drl_av.env.transition import Transition
from drl_av.errors import ConfigError
from drl_av.evaluation import PROVENANCE
from drl_av.evaluation.criticality import CriticalityResult
from drl_av.evaluation.provenance import read_provenance
from drl_av.evaluation.replay import ReplaySession
from drl_av.evaluation.table import report_corrupt_table, results_of, stored_config
from drl_av.files import read_table
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot
from drl_av.safety.paper import closing_speed, time_to_collision

LOW_IS_WORSE = ("min_", "mean_speed", "mean_r", "comfortable")
"""How the columns begin whose smallest value is the worst."""
ON_A_SHEET = 10
TILE = (640, 360)
"""Width and height of a picture on the sheet, px."""


def worst_sessions(
    table: Path, column: str, word: str | None, custom: CustomParts, count: int
) -> list[ReplaySession]:
    """Return the sessions that drive the ``count`` worst episodes of a table again.

    ``column`` is the column whose value makes an episode bad. ``word`` names a driver as on the
    command line, if its name in the table is not such a word. ``custom`` holds the user's parts.

    Raises:
        ConfigError: there is no such column, or the driver of an episode cannot be found.
        DrlAvError: the table or the provenance beside it is missing or damaged.
    """
    beside = table.with_suffix(PROVENANCE)
    with report_corrupt_table(table):
        rows = read_table(table)
        kind = CriticalityResult if rows and "driven_m" in rows[0] else EpisodeResult
        results = results_of(rows, kind)
        config = stored_config(read_provenance(beside, table)["settings"], beside.name)
    numbers = [name for name, value in vars(results[0]).items() if not isinstance(value, str)]
    if column not in numbers:
        raise ConfigError(
            f"{table} has no numbers in a column {column!r}{did_you_mean(column, numbers)}: name "
            f"one of: {', '.join(numbers)}."
        )
    sign = 1.0 if column.startswith(LOW_IS_WORSE) else -1.0
    worst = sorted(results, key=lambda row: sign * getattr(row, column))[:count]
    specs = _specs(dict.fromkeys(row.driver for row in worst), word)
    check = None if custom.safety_check is None else custom_check(custom.safety_check, config)
    drivers = make_drivers(list(specs.values()), config, check)
    sessions = []
    for row in worst:
        spec = specs[row.driver]
        own = custom._replace(safety_check=None) if spec.under else custom
        driven = spec.config(config), drivers[row.driver], row.driver, row.seed, row.vehicles
        sessions.append(ReplaySession(*driven, custom=own, expected=row))
    return sessions


def _specs(names: Iterable[str], word: str | None) -> dict[str, DriverSpec]:
    """Return the drivers of a table by name, that of ``word`` among them."""
    given = {} if word is None else {spec.name: spec for spec in find_drivers([word])}
    try:
        return {name: given[name] if name in given else find_drivers([name])[0] for name in names}
    except ConfigError as error:
        raise ConfigError(
            f"{error.args[0][:-1]}: name the table's driver with --driver."
        ) from error


class CriticalMoment:
    """Watches an episode, and keeps its collision or its smallest time to collision."""

    def __init__(self, caption: Caption, road: Road) -> None:
        self._caption, self._road, self._least_s = caption, road, math.inf
        self._shown: tuple[Snapshot, Caption] | None = None

    def __call__(self, decision: Transition) -> None:
        """Look at the next decision of the episode."""
        self._caption = next_caption(self._caption, decision, self._road)
        front = decision.next_scene.affordances.own_front
        ttc_s = math.inf if front is None else time_to_collision(front.gap_m, closing_speed(front))
        if self._shown is None or ttc_s < self._least_s or decision.collision is not None:
            self._shown = decision.next_scene.snapshot, self._caption
            self._least_s = ttc_s

    def picture(self) -> Picture:
        """Draw the moment, with the size of a ``TILE``; the episode needs a decision."""
        assert self._shown is not None
        snapshot, caption = self._shown
        return draw(snapshot, self._road, caption, TILE)


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
        moment = CriticalMoment(Caption(driver=title, seed=session.seed), session.road)
        session.drive(None, moment)
        sheet.paste(Image.fromarray(moment.picture()), (width * (place % 2), height * (place // 2)))
    data = io.BytesIO()
    sheet.save(data, "PNG")
    return data.getvalue()
