"""Learning curves: trainings killed, spread and lost count once; a table holds one setting only."""

import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drl_av.config import Config
from drl_av.errors import DrlAvError, RunError
from drl_av.experiments import legs
from drl_av.experiments import trainings as module
from drl_av.experiments.curves import curves
from drl_av.experiments.legs import Leg, blocks_of, drive_leg, evaluations_of, wall_time_s
from drl_av.experiments.options import Scale
from drl_av.experiments.tables import read_rows
from drl_av.experiments.trainings import merged
from drl_av.learning.training import EpisodeRow, Training

TINY = (
    Config()
    .updated("simulation", decisions_per_episode=20)
    .updated("learning", episodes=12, evaluate_every=3, checkpoint_every=2, evaluation_episodes=2)
)
LAST = 9
"""Episode at which the longer trainings are killed once, of 12; their last checkpoint is 8's."""


def scale(folder: Path, config: Config = TINY, **settings: Any) -> Scale:
    file = folder / "settings.toml"
    file.write_text(config.to_toml())
    usual = Scale(variants=("paper",), seeds=2, episodes=6, runs=folder / "runs", out=folder)
    return usual._replace(config=str(file), **settings)


def make(wanted: Scale) -> list[Any]:
    return list(curves(wanted))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made without an engine, in this process; not to be changed."""
    folder = tmp_path_factory.mktemp("undisturbed")

    def here(work: Callable[[Leg], None], jobs: list[Leg], processes: int) -> Any:
        for job in jobs:
            work(job)
            yield [job]

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(module.ENGINES, "here", here)
        make(scale(folder, engine="here"))
    return folder


def files_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def doomed(last: int) -> Callable[[Leg], None]:
    """Work that is killed once, after that episode of seed 0, and keeps a log of its episodes."""

    def work(leg: Leg) -> None:  # goes to its process by value, with all it names
        from drl_av.learning.run import Run, Training

        mark, log = leg.folder.with_suffix(".killed"), leg.folder.with_suffix(".log")
        append, run_episode = Run.append, Training.run_episode

        def logged(training: Training) -> Any:
            row = run_episode(training)
            with log.open("a") as file:
                file.write(f"{row.episode}\n")
            return row

        def deadly(run: Run, file: Path, row: Any) -> None:
            append(run, file, row)
            if row.episode == last and leg.seed == 0 and not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)

        Run.append, Training.run_episode = deadly, logged  # type: ignore[method-assign]
        try:
            drive_leg(leg)
        finally:
            Run.append, Training.run_episode = append, run_episode  # type: ignore[method-assign]

    return work


@pytest.mark.parametrize(("engine", "seeds"), [("loky", 1), ("ray", 2)])
def test_killed_worker_is_begun_again_at_its_checkpoint_and_nothing_counts_twice(
    engine: str, seeds: int, undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "drive_leg", doomed(LAST))
    told = make(scale(tmp_path, engine=engine, seeds=seeds))
    assert (tmp_path / "runs" / "paper-0.killed").exists()
    driven = [int(line) for line in (tmp_path / "runs" / "paper-0.log").read_text().split()]
    assert driven == [*range(1, 10), *range(9, 13)]  # 9 was on disk, but in no checkpoint
    expected = read_rows(undisturbed / "curves.csv")
    found = read_rows(tmp_path / "curves.csv")
    assert found == [row for row in expected if int(row["seed"]) < seeds]
    for seed in range(seeds):
        name = f"paper-{seed}"
        assert files_of(tmp_path / "runs" / name) == files_of(undisturbed / "runs" / name)
    assert told[-1].done == told[-1].total == (12 if seeds == 1 else 12 + 6)


def test_the_table_has_every_evaluation_once_and_says_what_made_it(undisturbed: Path) -> None:
    rows = read_rows(undisturbed / "curves.csv")
    places = [(row["variant"], row["seed"], row["episode"]) for row in rows]
    first = [("paper", "0", str(episode)) for episode in (3, 6, 9, 12)]
    assert places == [*first, ("paper", "1", "3"), ("paper", "1", "6")]
    facts = json.loads((undisturbed / "curves.json").read_text())
    assert facts["step_length_s"] == 0.5
    assert facts["settings"]["paper"]["learning"]["episodes"] == 12
    names = ("paper-0", "paper-1")
    clocks = {name: wall_time_s(undisturbed / "runs" / f"{name}.seconds.csv") for name in names}
    assert facts["wall_time_s"] == pytest.approx(clocks, abs=0.05)
    assert {"command", "date", "eclipse-sumo", "torch", "machine", "integration"} <= set(facts)


def test_what_the_table_holds_is_not_trained_again_though_the_folders_are_lost(
    undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("curves.csv", "curves.json"):
        shutil.copy(undisturbed / name, tmp_path)
    asked: list[Leg] = []

    def refusing(work: object, jobs: list[Leg], processes: int) -> Any:
        asked.extend(jobs)
        yield jobs

    monkeypatch.setitem(module.ENGINES, "loky", refusing)
    told = make(scale(tmp_path))
    assert not asked
    assert (told[-1].done, told[-1].total) == (18, 18)
    assert (tmp_path / "curves.csv").read_bytes() == (undisturbed / "curves.csv").read_bytes()
    with pytest.raises(DrlAvError, match=r"paper-1 lacks rows .* up to episode 9"):
        make(scale(tmp_path, seeds=3, episodes=9))
    assert [(leg.seed, leg.stop) for leg in asked] == [(1, 9), (2, 9)]


def test_a_table_of_other_settings_is_refused_and_left(undisturbed: Path, tmp_path: Path) -> None:
    for name in ("curves.csv", "curves.json"):
        shutil.copy(undisturbed / name, tmp_path)
    other = TINY.updated("learning", batch_size=32)
    with pytest.raises(DrlAvError, match=r"made with other settings.*--out"):
        make(scale(tmp_path, config=other))
    assert (tmp_path / "curves.csv").read_bytes() == (undisturbed / "curves.csv").read_bytes()


def test_rows_of_a_folder_of_other_settings_never_reach_a_table(
    undisturbed: Path, tmp_path: Path
) -> None:
    other = scale(tmp_path, config=TINY.updated("learning", batch_size=32))
    with pytest.raises(RunError, match=r"begun with other settings.*--runs"):
        make(other._replace(runs=undisturbed / "runs"))
    assert not (tmp_path / "curves.csv").exists()


def test_fewer_episodes_than_a_row_sums_up_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DrlAvError, match=r"2 episodes make no row of curves\.csv.* sums up 3"):
        make(scale(tmp_path, episodes=2, full_seeds=0))


def test_a_folder_of_other_settings_is_refused(undisturbed: Path) -> None:
    other = TINY.updated("learning", batch_size=32)
    with pytest.raises(RunError, match=r"begun with other settings.*--runs"):
        drive_leg(Leg("paper", 0, 12, other, undisturbed / "runs" / "paper-0", 3))


def table(*rows: tuple[str, int, int, str]) -> list[dict[str, str]]:
    return [
        {"variant": variant, "seed": str(seed), "episode": str(episode), "mean_reward": reward}
        for variant, seed, episode, reward in rows
    ]


def test_each_training_is_taken_from_the_side_that_got_further() -> None:
    stored = table(
        ("paper", 10, 100, "stored"),
        ("paper", 2, 100, "stored"),
        ("paper", 2, 200, "stored"),
        ("permit_all", 2, 100, "stored"),
    )
    found = table(
        ("permit_all", 2, 100, "found"),
        ("paper", 2, 100, "found"),  # begun anew, not as far: no mixture of the two
        ("paper", 10, 100, "found"),
        ("paper", 10, 200, "found"),
    )
    assert merged(stored, found, ("paper", "permit_all")) == table(
        ("paper", 2, 100, "stored"),
        ("paper", 2, 200, "stored"),
        ("paper", 10, 100, "found"),
        ("paper", 10, 200, "found"),
        ("permit_all", 2, 100, "found"),
    )


def test_an_episode_that_stands_there_twice_is_told() -> None:
    twice = table(("paper", 0, 100, "a"), ("paper", 1, 100, "a"), ("paper", 0, 100, "b"))
    with pytest.raises(DrlAvError, match="episode 100 of paper, seed 0, twice"):
        merged(twice, [], ("paper",))


def test_training_episodes_are_counted_with_the_evaluation_after_them(tmp_path: Path) -> None:
    header = "episode,mean_reward,safety_triggers,collided,ego_hit\n"
    lines = ["1,-1,4,True,True", "2,-3,0,False,False", "3,-5,8,True,False", "4,-7,0,False,False"]
    (tmp_path / "episodes.csv").write_text(header + "\n".join([*lines, "5,-900,1,Tr"]))
    (tmp_path / "evaluations.csv").write_text("episode,mean_reward\n2,-0.5\n4,-0.25\n6,-0.12")
    rows = evaluations_of(
        Leg("paper", 7, 12, TINY, tmp_path, 2)
    )  # both files end in the midst of a row
    assert [(row["seed"], row["episode"], row["mean_reward"]) for row in rows] == [
        ("7", "2", "-0.5"),
        ("7", "4", "-0.25"),
    ]
    assert [row["training_reward"] for row in rows] == ["-2", "-6"]
    assert [row["training_collisions"] for row in rows] == ["0.5", "0.5"]
    assert [row["training_ego_hits"] for row in rows] == ["0.5", "0"]
    assert [row["training_safety_triggers"] for row in rows] == ["2", "4"]


def test_blocks_are_means_of_as_many_episodes_and_the_last_of_what_is_left(tmp_path: Path) -> None:
    header = "episode,mean_reward,safety_triggers,collided,ego_hit\n"
    lines = [f"{n},-1,{n},{n == 4},False\n" for n in range(1, 12)]
    (tmp_path / "episodes.csv").write_text(header + "".join(lines))
    whole = blocks_of(Leg("adaptation", 0, 12, TINY, tmp_path, 4))  # of 12 episodes 11 are there
    assert [row["episode"] for row in whole] == ["4", "8"]
    assert [row["training_safety_triggers"] for row in whole] == ["2.5", "6.5"]
    assert [row["training_collisions"] for row in whole] == ["0.25", "0"]
    (tmp_path / "episodes.csv").write_text(header + "".join([*lines, "12,-1,30,False,False\n"]))
    odd = blocks_of(Leg("adaptation", 0, 12, TINY, tmp_path, 5))
    assert [row["episode"] for row in odd] == ["5", "10", "12"]
    assert [row["training_safety_triggers"] for row in odd] == ["3", "8", "20.5"]


def test_the_clock_of_a_training_that_was_killed_and_stopped_has_each_episode_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leg = Leg("paper", 0, 3, TINY, tmp_path / "paper-0", 3)
    now_s, drive = [0.0], Training.run_episode

    def ten_seconds(training: Training) -> EpisodeRow:
        now_s[0] += 10.0
        if now_s == [60.0]:  # in episode 6; the last checkpoint is of episode 4
            raise KeyboardInterrupt
        return drive(training)

    monkeypatch.setattr(Training, "run_episode", ten_seconds)
    monkeypatch.setattr(legs.time, "monotonic", lambda: now_s[0])
    drive_leg(leg)
    assert leg.clock.read_text() == "2,20.0\n3,10.0\n"
    with pytest.raises(KeyboardInterrupt):
        drive_leg(leg._replace(stop=7))
    drive_leg(leg._replace(stop=7))
    assert wall_time_s(leg.clock) == 70.0


def test_wall_time_counts_each_interval_once(tmp_path: Path) -> None:
    clock = tmp_path / "paper-0.seconds.csv"
    assert wall_time_s(clock) is None
    clock.write_text("100,5.0\n200,6.0\n100,4.0\n200,7.5\n")
    assert wall_time_s(clock) == 11.5


def test_a_line_of_the_clock_that_was_cut_short_does_not_count(tmp_path: Path) -> None:
    clock = tmp_path / "paper-0.seconds.csv"
    clock.write_text("100,5.0\n200,300,7.5\n400,6.0\n50")  # the disk was full, and a kill
    assert wall_time_s(clock) == 11.0


def test_an_evaluation_whose_episodes_are_lost_does_not_count(tmp_path: Path) -> None:
    header = "episode,mean_reward,safety_triggers,collided,ego_hit\n"
    (tmp_path / "episodes.csv").write_text(f"{header}1,-1,4,True,True\n2,-3,0,False,False\n")
    (tmp_path / "evaluations.csv").write_text("episode,mean_reward\n2,-0.5\n4,-0.25\n")
    rows = evaluations_of(Leg("paper", 7, 12, TINY, tmp_path, 2))
    assert [row["episode"] for row in rows] == ["2"]


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("curves.csv", (b"paper,0,3", b"papr,0,3")),
        ("curves.csv", (b"paper,0,3", b"paper,0,x")),
        ("curves.csv", (b"episode", b"epi\xffode")),
        ("curves.json", (b'"settings": {', b'"settings": [], "was": {')),
        ("curves.json", (b'"paper": {', b'"paper": 5, "was": {')),
    ],
)
def test_a_damaged_table_is_told_in_one_sentence_and_kept(
    name: str, damage: tuple[bytes, bytes], undisturbed: Path, tmp_path: Path
) -> None:
    shutil.copytree(undisturbed, tmp_path, dirs_exist_ok=True)
    whole = (tmp_path / name).read_bytes()
    spoilt = whole.replace(*damage, 1)
    assert spoilt != whole
    (tmp_path / name).write_bytes(spoilt)
    with pytest.raises(DrlAvError, match=r"curves.*damaged or of another version.*move them away"):
        make(scale(tmp_path))
    assert (tmp_path / name).read_bytes() == spoilt
