"""A table of evaluation episodes, of which only the missing ones are driven."""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import asdict
from time import monotonic
from typing import Any

from drl_av.config import Config
from drl_av.drivers.policy_file import find_policy
from drl_av.drivers.registry import DriverSpec
from drl_av.env.metrics import EpisodeResult
from drl_av.evaluation.comparison import Evaluation
from drl_av.experiments.options import Scale
from drl_av.experiments.provenance import (
    checksum,
    made_otherwise,
    provenance,
    read_sidecar,
    sidecar,
    stored_config,
    write_sidecar,
)
from drl_av.experiments.tables import intact, read_rows, seeds_held, write_rows
from drl_av.files import Row, require_writable


def columns(result: EpisodeResult, *names: str) -> Row:
    """What is known of an episode: the named columns, or all of them."""
    values = asdict(result)
    return {name: str(values[name]) for name in names or values}


class DrivenTable:
    """Episodes of some drivers in cells: rows that have some columns in common.

    Raises:
        DrlAvError: the file was made with other settings or another policy, or is damaged; or the
            disk refuses.
    """

    def __init__(
        self, scale: Scale, name: str, config: Config, choices: Sequence[DriverSpec]
    ) -> None:
        self._scale, self.config, self._choices = scale, config, choices
        self._identity: dict[str, str] = {}
        for choice in choices:
            if choice.run:
                self._identity["policy_sha256"] = checksum(find_policy(choice.run))
        self.path = scale.out / name
        scale.out.mkdir(parents=True, exist_ok=True)
        require_writable(self.path, sidecar(self.path))
        with intact(self.path):
            facts = read_sidecar(self.path)
            self.rows = read_rows(self.path)
            self._seeds()
            self._spent_s = float(facts["wall_time_s"]) if facts else 0.0
            if facts and not self._made(facts):
                raise made_otherwise(self.path)

    def of(self, cell: Row) -> list[Row]:
        """The rows of a cell."""
        return [row for row in self.rows if cell.items() <= row.items()]

    def drive(
        self,
        cell: Row,
        config: Config,
        vehicles: int,
        row_of: Callable[[EpisodeResult], Row] = columns,
    ) -> Generator[int, None, None]:
        """Drive what is missing of a cell; tells how many episodes of it there are.

        Raises:
            DrlAvError: as ``Evaluation``; the table has other columns; or the disk refuses.
        """
        with intact(self.path):
            first = seeds_held(self.of(cell), len(self._choices))
        if first >= self._scale.drives:
            return
        seeds = range(first, self._scale.drives)
        evaluation = Evaluation(config, self._choices, [vehicles], seeds)
        begun_s, here = monotonic(), []
        with closing(evaluation.rows(self._scale.jobs)) as found:
            for result in found:
                row = row_of(result)
                if self.rows and row.keys() != self.rows[0].keys():
                    raise made_otherwise(self.path)
                here.append(row)
                yield first * len(self._choices) + len(here)
        self._spent_s += monotonic() - begun_s
        ends = [place for place, row in enumerate(self.rows, 1) if cell.items() <= row.items()]
        end = ends[-1] if ends else len(self.rows)
        self.rows[end:end] = here
        write_sidecar(self.path, self.facts())
        write_rows(self.path, self.rows)

    def facts(self) -> dict[str, Any]:
        """What made the rows."""
        return provenance(
            self.config,
            processes=self._scale.jobs,
            seeds=self._seeds(),
            wall_time_s=round(self._spent_s, 1),
            **self._identity,
            settings=asdict(self.config),
        )

    def _seeds(self) -> str:
        seeds = sorted(int(row["seed"]) for row in self.rows)
        return f"{seeds[0]} to {seeds[-1]}" if seeds else ""

    def _made(self, facts: dict[str, Any]) -> bool:
        """Whether these drivers with these settings made the rows."""
        if facts.get("policy_sha256") != self._identity.get("policy_sha256"):
            return False
        return stored_config(facts["settings"], str(sidecar(self.path))) == self.config
