"""Learning beside a closed lane, with the check and without (Sec. II-C, Fig. 1)."""

from collections.abc import Generator
from dataclasses import asdict
from time import monotonic

from drl_av.experiments.barricade_training import (
    CHECKS,
    EPISODES,
    SCENARIO,
    SEEDS,
    TRAINED_EPISODES,
    barricade_rows,
    study_config,
    write_barricade_rows,
)
from drl_av.experiments.options import Progress, Scale
from drl_av.experiments.provenance import (
    made_otherwise,
    provenance,
    read_sidecar,
    sidecar,
    stored_config,
    write_sidecar,
)
from drl_av.experiments.tables import intact
from drl_av.files import require_writable

TABLE = "barricade.csv"


def barricade(scale: Scale) -> Generator[Progress, None, None]:
    """Write ``barricade.csv``, unless it is there.

    Its size is the study's own: minutes, whatever the scale.

    Raises:
        DrlAvError: the table was made with other settings; or the disk refuses.
    """
    scale.out.mkdir(parents=True, exist_ok=True)
    table = scale.out / TABLE
    require_writable(table, sidecar(table))
    configs = [
        scale.over(study_config(check, seed, EPISODES))
        .updated("simulation", scenario=SCENARIO)
        .updated("safety", check=check)
        .updated("learning", seed=seed)
        for seed in SEEDS
        for check in CHECKS
    ]
    with intact(table):
        if table.exists():
            if stored_config(read_sidecar(table)["settings"], str(sidecar(table))) != configs[0]:
                raise made_otherwise(table)
            return
    total = sum(config.learning.episodes + TRAINED_EPISODES for config in configs)
    begun_s, rows = monotonic(), []
    for config in configs:
        for row in barricade_rows(config, TRAINED_EPISODES):
            rows.append(row)
            yield Progress(len(rows), total, f"{row.safety_check}, seed {row.seed}")
    spent_s = round(monotonic() - begun_s, 1)
    seeds = f"{SEEDS[0]} to {SEEDS[-1]}"
    facts = provenance(configs[0], seeds=seeds, wall_time_s=spent_s, settings=asdict(configs[0]))
    write_sidecar(table, facts)
    write_barricade_rows(table, rows)
