"""Learning beside a closed lane, with the check and without (Sec. II-C, Fig. 1)."""

from collections.abc import Generator
from dataclasses import asdict
from time import monotonic

from drl_av.studies.barricade import (
    CHECKS,
    EPISODES,
    SEEDS,
    TRAINED_EPISODES,
    barricade_rows,
    study_config,
    write_barricade_rows,
)
from drl_av.studies.files import require_writable
from drl_av.studies.reproduction.provenance import (
    provenance,
    read_sidecar,
    sidecar,
    stored_config,
    write_sidecar,
)
from drl_av.studies.reproduction.scale import Progress, Scale
from drl_av.studies.reproduction.tables import intact

TABLE = "barricade.csv"


def barricade(scale: Scale) -> Generator[Progress, None, None]:
    """Write ``barricade.csv``, unless it is there, made with the same settings.

    Its size is the study's own: minutes, whatever the scale.

    Raises:
        DrlAvError: the disk refuses.
    """
    scale.out.mkdir(parents=True, exist_ok=True)
    table = scale.out / TABLE
    require_writable(table, sidecar(table))
    config = study_config(CHECKS[0], SEEDS[0], EPISODES)
    stored = read_sidecar(table).get("settings")
    with intact(table):
        if table.exists() and stored and stored_config(stored, str(sidecar(table))) == config:
            return
    total = len(SEEDS) * len(CHECKS) * (EPISODES + TRAINED_EPISODES)
    begun_s, rows = monotonic(), []
    for row in barricade_rows(SEEDS, EPISODES, TRAINED_EPISODES):
        rows.append(row)
        yield Progress(len(rows), total, f"{row.safety_check}, seed {row.seed}")
    write_barricade_rows(table, rows)
    spent_s = round(monotonic() - begun_s, 1)
    seeds = f"{SEEDS[0]} to {SEEDS[-1]}"
    facts = provenance(config, seeds=seeds, wall_time_s=spent_s, settings=asdict(config))
    write_sidecar(table, facts)
