"""Learning curves: trainings killed, spread and lost count once; a table holds one setting only."""

import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from runs import TINY, files_of

from drl_av.config import Config
from drl_av.errors import DrlAvError, RunError
from drl_av.evaluation import engines
from studies import plan as module
from studies.cells import training_plan
from studies.curves import CURVES
from studies.experiment import ResultsFolder, reproduce
from studies.options import Progress, ReproduceOptions
from studies.store import ResultStore
from studies.training_jobs import TrainingJob, train_job

LAST = 9
"""Episode at which the longer trainings are killed once, of 12; their last checkpoint is 8's."""


def options(folder: Path, config: Config = TINY, **changes: Any) -> ReproduceOptions:
    file = folder / "settings.toml"
    file.write_text(config.to_toml())
    usual = ReproduceOptions(("paper",), 2, 6, runs=folder / "runs", out=folder, engine="here")
    return usual._replace(config=(str(file),), **changes)


def make(wanted: ReproduceOptions) -> list[Progress]:
    return list(reproduce(CURVES, wanted))


@pytest.fixture
def made(undisturbed: Path, tmp_path: Path) -> Path:
    """A folder with the table of the undisturbed trainings."""
    for name in ("curves.csv", "curves.json"):
        shutil.copy(undisturbed / name, tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made in this process; not to be changed."""
    folder = tmp_path_factory.mktemp("undisturbed")
    wanted = options(folder)
    for cell in [cell for stage in CURVES.plan(wanted).stages for cell in stage]:
        assert cell.training
        train_job(cell.training)
    make(wanted)
    return folder


def doomed(last: int) -> Callable[[TrainingJob], None]:
    """Work that is killed once, after that episode of seed 0, and keeps a log of its episodes."""

    def work(job: TrainingJob) -> None:  # goes to its process by value, with all it names
        from drl_av.learning.run import Run, Training

        mark, log = job.folder.with_suffix(".killed"), job.folder.with_suffix(".log")
        append, run_episode = Run.append, Training.run_episode

        def logged(training: Training) -> Any:
            row = run_episode(training)
            with log.open("a") as file:
                file.write(f"{row.episode}\n")
            return row

        def deadly(run: Run, file: Path, row: Any) -> None:
            append(run, file, row)
            if row.episode == last and job.name == "paper-0" and not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)

        Run.append, Training.run_episode = deadly, logged  # type: ignore[method-assign]
        try:
            train_job(job)
        finally:
            Run.append, Training.run_episode = append, run_episode  # type: ignore[method-assign]

    return work


@pytest.mark.parametrize(
    ("engine", "seeds"), [("loky", 1), pytest.param("ray", 2, marks=pytest.mark.ray)]
)
def test_killed_worker_is_begun_again_at_its_checkpoint_and_nothing_counts_twice(
    engine: str, seeds: int, undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "train_job", doomed(LAST))
    steps = make(options(tmp_path, engine=engine, seeds=seeds))
    assert (tmp_path / "runs" / "paper-0.killed").exists()
    driven = [int(line) for line in (tmp_path / "runs" / "paper-0.log").read_text().split()]
    assert driven == [*range(1, 10), *range(9, 13)]  # 9 was on disk, but in no checkpoint
    expected = ResultsFolder(undisturbed).rows("curves.csv")
    found = ResultsFolder(tmp_path).rows("curves.csv")
    assert found == [row for row in expected if int(row["seed"]) < seeds]
    for name in [f"paper-{seed}" for seed in range(seeds)]:
        assert files_of(tmp_path / "runs" / name) == files_of(undisturbed / "runs" / name)
    [*_, last] = [step for step in steps if step.label == "training"]
    assert (last.done, last.total) == (12, 12)  # of the longer one


def test_the_table_has_every_evaluation_once_and_says_what_made_it(undisturbed: Path) -> None:
    rows = ResultsFolder(undisturbed).rows("curves.csv")
    places = [(row["variant"], row["seed"], row["episode"]) for row in rows]
    first = [("paper", "0", str(episode)) for episode in (3, 6, 9, 12)]
    assert places == [*first, ("paper", "1", "3"), ("paper", "1", "6")]
    facts = json.loads((undisturbed / "curves.json").read_text())
    assert (facts["step_length_s"], facts["seeds"]) == (0.5, "0 to 1")
    assert facts["settings"]["paper"]["learning"]["episodes"] == 12
    assert facts["wall_time_s"].keys() == {"paper-0", "paper-1"}
    assert {"command", "date", "eclipse-sumo", "torch", "machine", "integration"} <= set(facts)


def test_what_the_table_holds_is_not_trained_again_though_the_folders_are_lost(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, asked = (made / "curves.csv").read_bytes(), list[TrainingJob]()

    def refusing(work: object, jobs: list[TrainingJob], processes: int) -> Any:
        asked.extend(jobs)
        yield jobs

    monkeypatch.setitem(engines.ENGINES, "here", refusing)
    assert not [step for step in make(options(made)) if step.label]
    assert not asked
    assert (made / "curves.csv").read_bytes() == before
    with pytest.raises(DrlAvError, match=r"paper-1 lacks rows .* up to episode 9"):
        make(options(made, seeds=3, episodes=9))
    assert [(job.name, job.stop) for job in asked] == [("paper-1", 9), ("paper-2", 9)]


def test_rows_of_a_folder_of_other_settings_never_reach_a_table(
    undisturbed: Path, tmp_path: Path
) -> None:
    other = options(tmp_path, config=TINY.updated("learning", batch_size=32))
    with pytest.raises(RunError, match=r"begun with other settings.*--runs"):
        make(other._replace(runs=undisturbed / "runs"))
    assert not (tmp_path / "curves.csv").exists()


def test_fewer_episodes_than_a_row_sums_up_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DrlAvError, match=r"2 episodes makes no row of the table, which sums up 3"):
        make(options(tmp_path, episodes=2, full_seeds=0))


def table(*rows: tuple[str, int, int, str]) -> list[dict[str, str]]:
    return [
        {"variant": variant, "seed": str(seed), "episode": str(episode), "mean_reward": reward}
        for variant, seed, episode, reward in rows
    ]


def test_each_training_is_taken_from_the_side_that_got_further(tmp_path: Path) -> None:
    plan = training_plan({"paper": TINY, "permit_all": TINY}, [], lambda job: [])
    store = ResultStore(tmp_path / "curves.csv", plan.made_with, plan.order)
    store.put({"variant": "paper", "seed": "10"}, table(("paper", 10, 100, "-0.5")))
    two = table(("paper", 2, 100, "-0.5"), ("paper", 2, 200, "-0.5"))
    store.put({"variant": "paper", "seed": "2"}, two)
    store.put({"variant": "permit_all", "seed": "2"}, table(("permit_all", 2, 100, "-0.5")))
    same = table(("permit_all", 2, 100, "-0.25"))
    assert not store.put({"variant": "permit_all", "seed": "2"}, same)
    restarted = table(("paper", 2, 100, "-0.25"))  # not as far: no mixture of the two
    assert not store.put({"variant": "paper", "seed": "2"}, restarted)
    further = table(("paper", 10, 100, "-0.25"), ("paper", 10, 200, "-0.25"))
    assert store.put({"variant": "paper", "seed": "10"}, further)
    assert store.rows == [*two, *further, *table(("permit_all", 2, 100, "-0.5"))]
