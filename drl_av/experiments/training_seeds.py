"""The training of the shipped driver with several seeds, evaluated under ``strict`` (ours)."""

from drl_av.config import SINGLE_KINDS
from drl_av.experiments.cells import Drives, driven_with
from drl_av.experiments.cross_table import REFERENCE, gain_markdown, hits_markdown
from drl_av.experiments.density_sweep import DRIVER
from drl_av.experiments.experiment import Experiment, Results
from drl_av.experiments.options import ReproduceOptions
from drl_av.experiments.plan import Plan
from drl_av.experiments.training_jobs import TrainingJob
from drl_av.files import Row

NAME = "seed "
"""Beginning of the names of the trained drivers; the seed of the training follows."""
DENSITIES = (5, 10, 15, 20, 25)
DRIVES = 20
"""Largest number of episodes of a driver at one density in one kind of traffic."""
FIRST_SEED = 960_000
COLUMNS = ("seed", "mean_speed_m_s", "collided", "ego_hit")


def training_seeds_plan(options: ReproduceOptions) -> Plan:
    """Plan ``options.seeds`` trainings with the settings of the shipped driver, under ``paper``.

    Their drivers, the shipped one and ``REFERENCE`` then drive under ``strict``, on the same
    traffic seeds in each kind of traffic.
    """
    trained = options.settings_of([DRIVER])
    strict = trained.updated("safety", check="strict")
    jobs = [
        TrainingJob(
            DRIVER,
            trained.updated("learning", seed=seed),
            trained.learning.episodes,
            options.runs / f"shipped-{seed}",
            trained.learning.evaluate_every,
        )
        for seed in range(options.seeds)
    ]
    drivers: list[tuple[str, str, TrainingJob | None]] = [
        (REFERENCE, REFERENCE, None),
        (DRIVER, DRIVER, None),
        *((f"{NAME}{seed}", str(job.folder), job) for seed, job in enumerate(jobs)),
    ]
    cells = [
        Drives(
            strict.with_traffic(kind),
            (driver,),
            vehicles,
            min(options.drives, DRIVES),
            COLUMNS,
            (("driver", name), ("traffic", kind)),
            job,
            FIRST_SEED,
        )
        for name, driver, job in drivers
        for kind in SINGLE_KINDS
        for vehicles in DENSITIES
    ]
    made_with = driven_with(strict, [DRIVER])._replace(
        settings={name: job.config if job else strict for name, _, job in drivers},
        episodes={f"{NAME}{seed}": job.stop for seed, job in enumerate(jobs)},
    )
    policies = {DRIVER: made_with.policies[""]}
    return Plan(made_with._replace(policies=policies), [cells], _place, named="driver")


def _place(row: Row) -> tuple[int, int, int, int]:
    name = row["driver"]
    rules = (REFERENCE, DRIVER)
    driver = rules.index(name) if name in rules else len(rules) + int(name.removeprefix(NAME))
    vehicles = DENSITIES.index(int(row["vehicles"]))
    return driver, SINGLE_KINDS.index(row["traffic"]), vehicles, int(row["seed"])


def gain_table(results: Results) -> str:
    """Return the Markdown table of each driver's gain over ``REFERENCE``, with its worst kind."""
    return gain_markdown(results.rows(TRAINING_SEEDS.table))


def hits_table(results: Results) -> str:
    """Return the Markdown table of each driver's collisions in each kind of traffic."""
    return hits_markdown(results.rows(TRAINING_SEEDS.table))


TRAINING_SEEDS = Experiment(
    name="training_seeds",
    meaning="the training of the shipped driver with several seeds, evaluated under strict",
    row="an episode of a driver in a kind of traffic",
    plan=training_seeds_plan,
    summaries={"training_seeds": gain_table, "training_seeds_hits": hits_table},
)
