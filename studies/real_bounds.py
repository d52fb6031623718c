"""Measures the speed that the check ``strict`` costs if its bounds are those of real traffic.

In real traffic a vehicle brakes with up to 9 m/s^2 and moves sideways at up to 2.1 m/s. This speed
is the mean maximum in the data set exiD, plus two standard deviations. All other bounds are those
of our traffic. The cost is measured for the shipped driver, and for drivers that were trained under
these bounds.
"""

from collections.abc import Iterable
from operator import itemgetter
from typing import TYPE_CHECKING

from drl_av.config.presets import preset
from drl_av.evaluation.figure_style import label_axes, panels
from drl_av.evaluation.statistics import Mean, grouped, mean_with_interval
from drl_av.files import Row
from studies.cells import TableDriver, made_with
from studies.density_sweep import DRIVER
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import collisions, densities_of, markdown_table
from studies.options import ReproduceOptions
from studies.plan import Plan
from studies.strictness import draw_changes, speed_change, under
from studies.training_jobs import TrainingJob

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = ("seed", "mean_speed_m_s", "collided", "ego_hit", "safety_triggers")
FIRST_SEED = 920_000
"""First traffic seed; no tuning and no other experiment uses this block of seeds.

Only ``verification.clairvoyant`` begins with the same seed.
"""
DENSITIES = (1, 5, 10, 15, 20, 25, 30, 40)
TRAININGS, DRIVES = 3, 50
"""Largest number of trainings, and of episodes of a driver at one density."""
LABELS = {
    (DRIVER, "strict"): "shipped driver, bounds of our traffic",
    (DRIVER, "real"): "shipped driver, bounds of real traffic",
    ("trained", "real"): "trained under the bounds of real traffic",
}
"""The label of each curve, by kind of driver and bounds."""


def trainings(options: ReproduceOptions) -> list[TrainingJob]:
    """Return the trainings under the real bounds with the preset ``fast``, one for each seed."""
    config = under(options.with_files(preset("fast")), "real").updated(
        "learning", evaluate_every=100
    )
    return [
        TrainingJob.whole(
            "trained", config.updated("learning", seed=seed), options.runs / f"real_bounds-{seed}"
        )
        for seed in range(min(options.seeds, TRAININGS))
    ]


def real_bounds_plan(options: ReproduceOptions) -> Plan:
    """Return a plan to evaluate the shipped driver under ``paper`` and both bounds of ``strict``.

    Drivers that are trained under the real bounds are evaluated under the real bounds.
    """
    jobs = trainings(options)
    config = options.settings_of([DRIVER])
    shipped = TableDriver(DRIVER, DRIVER, config)
    trained = [TableDriver(job.name, str(job.folder), job.config, job) for job in jobs]
    drivers = [
        (shipped._replace(config=under(config, bounds)), bounds)
        for bounds in ("paper", "strict", "real")
    ]
    drivers += [(each, "real") for each in trained]
    cells = [
        each._replace(named=(("driver", each.name), ("bounds", bounds))).drives(
            vehicles, min(options.drives, DRIVES), COLUMNS, FIRST_SEED
        )
        for each, bounds in drivers
        for vehicles in DENSITIES
    ]
    order = [(DRIVER, bounds) for bounds in ("paper", "strict", "real")]
    order += [(f"real_bounds-{seed}", "real") for seed in range(TRAININGS)]

    def place(row: Row) -> tuple[int, int, int]:
        vehicles = DENSITIES.index(int(row["vehicles"]))
        return order.index((row["driver"], row["bounds"])), vehicles, int(row["seed"])

    return Plan(made_with([shipped, *trained]), [cells], place, named="driver")


def driven(rows: Iterable[Row], kind: str, bounds: str, vehicles: int) -> list[list[Row]]:
    """Return the rows under ``bounds`` at one density, one list for each driver of a kind.

    ``kind`` is ``pretrained`` or ``trained``.
    """
    own = [
        row
        for row in rows
        if (row["driver"] == DRIVER) == (kind == DRIVER)
        and (row["bounds"], int(row["vehicles"])) == (bounds, vehicles)
    ]
    return list(grouped(own, itemgetter("driver")).values())


def cost(rows: list[Row], kind: str, bounds: str, vehicles: int) -> Mean:
    """Return the change in mean speed relative to the shipped driver under ``paper``, percent.

    With several drivers the interval is over the drivers, with one driver over the traffic seeds.

    Raises:
        DrlAvError: the traffic seeds differ.
    """
    [plain] = driven(rows, DRIVER, "paper", vehicles)
    changes = [speed_change(own, plain) for own in driven(rows, kind, bounds, vehicles)]
    return changes[0] if len(changes) == 1 else mean_with_interval(c.value for c in changes)


def real_bounds_table(results: ResultsFolder) -> str:
    """Return the Markdown table of speed changes and collisions, for each driver and bounds."""
    rows = results.rows(REAL_BOUNDS.table)
    densities, lines = densities_of(rows), []
    for (kind, bounds), label in LABELS.items():
        own = [driven(rows, kind, bounds, number) for number in densities]
        if all(own):
            changes = [str(cost(rows, kind, bounds, number)) for number in densities]
            hits, was_hit = collisions([row for group in own for rows_ in group for row in rows_])
            episodes = sum(len(rows_) for group in own for rows_ in group)
            lines.append([label, *changes, f"{hits} / {was_hit} of {episodes}"])
    names = ("change, %, vehicles:", *map(str, densities), "ego hit / was hit")
    return markdown_table(names, lines)


def real_bounds_figure(rows: list[Row]) -> "Figure":
    """Draw the change in mean speed, and the episodes with a collision, by density."""
    figure, (left, right) = panels((11.5, 4), 1, 2)
    densities = densities_of(rows)
    for mark, ((kind, bounds), label) in zip("ovs", LABELS.items(), strict=True):
        groups = [driven(rows, kind, bounds, number) for number in densities]
        if not all(groups):
            continue
        changes = [cost(rows, kind, bounds, number) for number in densities]
        draw_changes(left, densities, changes, marker=mark, label=label)
        episodes = [[row for own in group for row in own] for group in groups]
        share = [100 * sum(collisions(own)) / len(own) for own in episodes]
        right.plot(densities, share, marker=mark, clip_on=False)
    left.axhline(0.0, color="#999999", linewidth=1)
    label_axes(left, "vehicles on the loop", "change of the mean speed, %")
    right.set_ylim(0.0, max(5.0, right.get_ylim()[1]))
    label_axes(right, "vehicles on the loop", "episodes with a collision, %")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return figure


REAL_BOUNDS = Experiment(
    name="real_bounds",
    meaning="the speed that strict costs with the bounds of real traffic, also for drivers "
    "trained under them",
    row="an episode under paper, or under strict with the bounds of our or of real traffic",
    plan=real_bounds_plan,
    summaries={"real_bounds": real_bounds_table},
    figures={"real_bounds": real_bounds_figure},
)
