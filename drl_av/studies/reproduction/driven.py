"""A table of evaluation episodes, of which only the missing ones are driven."""

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import asdict, fields
from time import monotonic
from typing import Any

from drl_av.config import Config
from drl_av.episode import EpisodeResult
from drl_av.studies.drivers import Choice, policy_file
from drl_av.studies.evaluation import Evaluation, write_rows
from drl_av.studies.files import require_writable
from drl_av.studies.reproduction.provenance import (
    checksum,
    provenance,
    read_sidecar,
    sidecar,
    stored_config,
    write_sidecar,
)
from drl_av.studies.reproduction.scale import Scale
from drl_av.studies.reproduction.tables import Row, intact, read_rows


class DrivenTable:
    """Some drivers on the same traffic, ``scale.drives`` episodes at each number of vehicles.

    Rows that the file holds already, made with the same settings and policy, are kept.

    Raises:
        DrlAvError: the file is damaged, or the disk refuses.
    """

    def __init__(self, scale: Scale, name: str, config: Config, choices: Sequence[Choice]) -> None:
        self._scale, self._config, self._choices = scale, config, choices
        self._identity: dict[str, str] = {}
        for choice in choices:
            if choice.run:
                self._identity["policy_sha256"] = checksum(policy_file(choice.run))
        self.path = scale.out / name
        scale.out.mkdir(parents=True, exist_ok=True)
        require_writable(self.path, sidecar(self.path))
        with intact(self.path):
            self.rows, self._spent_s = self._kept()

    def at(self, vehicles: int) -> list[EpisodeResult]:
        """The rows of one number of vehicles."""
        drives = self._scale.drives
        return [row for row in self.rows if row.vehicles == vehicles and row.seed < drives]

    def drive(self, vehicles: int) -> Generator[int, None, None]:
        """Drive one number of vehicles, where rows of it are missing; tells how many are driven.

        Raises:
            DrlAvError: as ``Evaluation``; or the disk refuses.
        """
        seeds = range(self._scale.drives)
        evaluation = Evaluation(self._config, self._choices, [vehicles], seeds)
        if len(self.at(vehicles)) >= len(evaluation):
            return
        begun_s, here = monotonic(), []
        with closing(evaluation.rows(self._scale.jobs)) as found:
            for row in found:
                here.append(row)
                yield len(here)
        self._spent_s += monotonic() - begun_s
        self.rows = [*(row for row in self.rows if row.vehicles != vehicles), *here]
        self.rows.sort(key=lambda row: row.vehicles)
        write_rows(self.path, self.rows)
        write_sidecar(self.path, self.facts())

    def facts(self) -> dict[str, Any]:
        """What made the rows."""
        return provenance(
            self._config,
            processes=self._scale.jobs,
            seeds=f"0 to {self._scale.drives - 1}",
            wall_time_s=round(self._spent_s, 1),
            **self._identity,
            settings=asdict(self._config),
        )

    def _kept(self) -> tuple[list[EpisodeResult], float]:
        """What an earlier command left that still holds, and the seconds spent on it."""
        facts = read_sidecar(self.path)
        if not facts or facts.get("policy_sha256") != self._identity.get("policy_sha256"):
            return [], 0.0
        if stored_config(facts["settings"], str(sidecar(self.path))) != self._config:
            return [], 0.0
        return list(map(_result, read_rows(self.path))), float(facts["wall_time_s"])


def _result(row: Row) -> EpisodeResult:
    values: dict[str, Any] = {
        item.name: row[item.name] == "True" if item.type is bool else item.type(row[item.name])  # type: ignore[operator]
        for item in fields(EpisodeResult)
    }
    return EpisodeResult(**values)
