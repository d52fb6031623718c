"""The training of the shipped driver with several seeds, evaluated under ``strict`` (ours)."""

from functools import partial

from drl_av.config import SINGLE_PRESETS
from studies.cells import TableDriver, made_with
from studies.cross_table import (
    REFERENCE,
    gain_over_reference_table,
    hits_table,
    in_each_kind,
)
from studies.density_sweep import DRIVER
from studies.experiment import Experiment
from studies.options import ReproduceOptions
from studies.plan import Plan, by
from studies.training_jobs import TrainingJob

NAME = "seed "
"""Beginning of the names of the trained drivers; the seed of the training follows."""
DENSITIES = (5, 10, 15, 20, 25)
DRIVES = 20
"""Largest number of episodes of a driver at one density in one kind of traffic."""
FIRST_SEED = 960_000
COLUMNS = ("seed", "mean_speed_m_s", "collided", "ego_hit")


def training_seeds_plan(options: ReproduceOptions) -> Plan:
    """Return a plan to repeat the shipped driver's training with several seeds, under ``paper``.

    The trainings have the seeds 0 to ``options.seeds`` - 1. Their drivers, the shipped one and
    ``REFERENCE`` then drive under ``strict``, on the same traffic seeds in each kind of traffic.
    """
    trained = options.settings_of([DRIVER])
    strict = trained.updated("safety", check="strict")
    jobs = [
        TrainingJob.whole(
            DRIVER, trained.updated("learning", seed=seed), options.runs / f"shipped-{seed}"
        )
        for seed in range(options.seeds)
    ]
    drivers = [TableDriver(name, name, strict) for name in (REFERENCE, DRIVER)]
    drivers += [
        TableDriver(f"{NAME}{seed}", str(job.folder), strict, job) for seed, job in enumerate(jobs)
    ]
    cells = in_each_kind(drivers, DENSITIES, FIRST_SEED, min(options.drives, DRIVES), COLUMNS)
    order = by(driver=_place, traffic=SINGLE_PRESETS, vehicles=DENSITIES, seed=int)
    return Plan(made_with(drivers), [cells], order, named="driver")


def _place(driver: str) -> int:
    first = (REFERENCE, DRIVER)
    return first.index(driver) if driver in first else len(first) + int(driver.removeprefix(NAME))


TRAINING_SEEDS = Experiment(
    name="training_seeds",
    meaning="the training of the shipped driver with several seeds, evaluated under strict",
    row="an episode of a driver in a kind of traffic",
    plan=training_seeds_plan,
    summaries={
        "training_seeds": partial(gain_over_reference_table, table="training_seeds.csv"),
        "training_seeds_hits": partial(hits_table, table="training_seeds.csv"),
    },
)
