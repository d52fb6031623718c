"""What a training reports: rows and wall times read from its folder, each episode once."""

from dataclasses import replace
from pathlib import Path

import pytest
from runs import TINY

from drl_av.errors import DrlAvError
from drl_av.learning.algorithm_1 import EpisodeRow, Training
from studies import trainings
from studies.trainings import TrainingJob, TrainingRows, blocks_of, evaluations_of, train_job

HEADER = "episode,mean_reward,safety_triggers,collided,ego_hit\n"


def job(folder: Path, every: int = 2, stop: int = 12, seed: int = 7) -> TrainingJob:
    return TrainingJob("paper", TINY.updated("learning", seed=seed), stop, folder, every)


def test_training_episodes_are_counted_with_the_evaluation_after_them(tmp_path: Path) -> None:
    lines = ["1,-1,4,True,True", "2,-3,0,False,False", "3,-5,8,True,False", "4,-7,0,False,False"]
    # both files end within a row that is being written
    (tmp_path / "episodes.csv").write_text(HEADER + "\n".join([*lines, "5,-900,1,Tr"]))
    (tmp_path / "evaluations.csv").write_text("episode,mean_reward\n2,-0.5\n4,-0.25\n6,-0.12")
    rows = evaluations_of(job(tmp_path))
    found = [(row["seed"], row["episode"], row["mean_reward"]) for row in rows]
    assert found == [("7", "2", "-0.5"), ("7", "4", "-0.25")]
    assert [row["training_reward"] for row in rows] == ["-2", "-6"]
    assert [row["training_collisions"] for row in rows] == ["0.5", "0.5"]
    assert [row["training_ego_hits"] for row in rows] == ["0.5", "0"]
    assert [row["training_safety_triggers"] for row in rows] == ["2", "4"]


def test_an_evaluation_whose_episodes_are_lost_does_not_count(tmp_path: Path) -> None:
    (tmp_path / "episodes.csv").write_text(f"{HEADER}1,-1,4,True,True\n2,-3,0,False,False\n")
    (tmp_path / "evaluations.csv").write_text("episode,mean_reward\n2,-0.5\n4,-0.25\n")
    assert [row["episode"] for row in evaluations_of(job(tmp_path))] == ["2"]


def test_blocks_are_means_of_as_many_episodes_and_the_last_of_what_is_left(tmp_path: Path) -> None:
    lines = [f"{n},-1,{n},{n == 4},False\n" for n in range(1, 12)]
    (tmp_path / "episodes.csv").write_text(HEADER + "".join(lines))
    whole = blocks_of(job(tmp_path, every=4))  # of 12 episodes 11 are there
    assert [row["episode"] for row in whole] == ["4", "8"]
    assert [row["training_safety_triggers"] for row in whole] == ["2.5", "6.5"]
    assert [row["training_collisions"] for row in whole] == ["0.25", "0"]
    (tmp_path / "episodes.csv").write_text(HEADER + "".join([*lines, "12,-1,30,False,False\n"]))
    odd = blocks_of(job(tmp_path, every=5))
    assert [row["episode"] for row in odd] == ["5", "10", "12"]
    assert [row["training_safety_triggers"] for row in odd] == ["3", "8", "20.5"]


def test_the_clock_of_a_training_that_was_killed_and_stopped_has_each_episode_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = job(tmp_path / "paper-0", stop=3)
    now_s, drive = [0.0], Training.run_episode

    def ten_seconds(training: Training) -> EpisodeRow:
        now_s[0] += 10.0
        if now_s == [60.0]:  # in episode 6; the last checkpoint is of episode 4
            raise KeyboardInterrupt
        return drive(training)

    monkeypatch.setattr(Training, "run_episode", ten_seconds)
    monkeypatch.setattr(trainings.time, "monotonic", lambda: now_s[0])
    train_job(short)
    assert short.clock.read_text() == "2,20.0\n3,10.0\n"
    with pytest.raises(KeyboardInterrupt):
        train_job(replace(short, stop=7))
    train_job(replace(short, stop=7))
    assert short.wall_time_s() == 70.0


@pytest.mark.parametrize(
    ("lines", "seconds"),
    [
        ("100,5.0\n200,6.0\n100,4.0\n200,7.5\n", 11.5),  # trained again: the later one counts
        ("100,5.0\n200,300,7.5\n400,6.0\n50", 11.0),  # the disk was full, and a kill
    ],
)
def test_wall_time_counts_each_whole_line_once(lines: str, seconds: float, tmp_path: Path) -> None:
    training = job(tmp_path / "paper-0")
    assert training.wall_time_s() is None
    training.clock.write_text(lines)
    assert training.wall_time_s() == seconds


def test_rows_that_a_training_makes_end_at_its_last_episode(tmp_path: Path) -> None:
    def ends(rows: TrainingRows, *held: int) -> list[str]:
        found = rows.keys([rows.job.key | {"episode": str(episode)} for episode in held])
        return [key["episode"] for key in found]

    whole = TrainingRows(job(tmp_path, every=5), blocks_of)  # 12 episodes, the whole schedule
    assert ends(whole) == ends(whole, 5, 10) == ends(whole, 5, 10, 12) == ["5", "10", "12"]
    assert ends(TrainingRows(job(tmp_path, every=5, stop=11), blocks_of), 5) == ["5", "10"]
    for held in ((10,), (5, 12), (5, 5)):
        with pytest.raises(ValueError, match="lacks a row before episode"):
            ends(whole, *held)
    with pytest.raises(DrlAvError, match="4 episodes makes no row of the table, which sums up 5"):
        ends(TrainingRows(job(tmp_path, every=5, stop=4), blocks_of))
