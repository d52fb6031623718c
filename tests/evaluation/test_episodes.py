"""Drivers on the same seeded traffic, the intervals of their means, and several processes."""

import json
import math
import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from drives import RESULT
from programs import python
from runs import SHORT, Capsys, run_folder

from drl_av import cli
from drl_av.drivers import policy_file, registry
from drl_av.drivers.registry import find_drivers
from drl_av.env import highway
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeResult
from drl_av.errors import ConfigError, DrlAvError, RunError
from drl_av.evaluation import episodes as module
from drl_av.evaluation.episodes import Evaluation, Setup, drive_episodes
from drl_av.evaluation.statistics import (
    Mean,
    mean_with_interval,
    overall,
    summarize,
    write_summaries,
)
from drl_av.evaluation.table import read_rows
from drl_av.simulation.simulation import Simulation

TINY = ["-o", "simulation.decisions_per_episode=10"]


def test_rows_come_by_vehicles_then_seed_then_driver() -> None:
    names = ["idm", "idm-sumo"]
    evaluation = Evaluation(Setup(SHORT, find_drivers(names)), (3, 1), range(8, 10))
    rows = drive_episodes(evaluation.jobs)
    assert [(row.vehicles, row.seed, row.driver) for row in rows] == [
        (number, seed, name) for number in (3, 1) for seed in (8, 9) for name in names
    ]


def test_two_episodes_need_one_environment_one_policy_one_scenario_and_two_resets(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done = Counter[str]()
    for owner, name in (
        (HighwayEnv, "__init__"),
        (highway, "load_scenario"),
        (registry, "load_scenario"),
        (policy_file, "load_policy"),
        (Simulation, "reset"),
    ):
        counted(monkeypatch, owner, name, done)
    words = ["evaluate", "pretrained-paper", "idm", "--vehicles", "5", "--episodes", "1"]
    assert cli.main(words) == 0
    assert done == {"__init__": 1, "load_scenario": 1, "load_policy": 1, "reset": 2}


def counted(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, done: Counter[str]) -> None:
    """Count the calls of a function."""
    function = getattr(owner, name)

    def counting(*arguments: Any, **options: Any) -> Any:
        done[name] += 1
        return function(*arguments, **options)

    monkeypatch.setattr(owner, name, counting)


def test_two_processes_drive_the_same_rows_in_the_same_order(tmp_path: Path) -> None:
    run = run_folder(tmp_path / "run")
    specs = find_drivers([str(run), "idm-sumo", "random"])
    evaluation = Evaluation(Setup(SHORT, specs), (2, 20), range(5, 8))
    one, two = (list(drive_episodes(evaluation.jobs, jobs)) for jobs in (1, 2))
    assert one == two
    assert len(one) == 18


def test_what_a_worker_process_raises_is_raised(tmp_path: Path) -> None:
    run = run_folder(tmp_path / "run")
    evaluation = Evaluation(Setup(SHORT, find_drivers([str(run)])), (2,), range(2))
    (run / "policy.safetensors").unlink()
    with pytest.raises(RunError, match="run holds no trained driver"):
        list(drive_episodes(evaluation.jobs, 2))


def test_a_worker_that_is_killed_is_replaced_and_no_row_is_lost_or_doubled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killing(*given: Any) -> Iterator[EpisodeResult]:
        for done, row in enumerate(drive_episodes(*given), 1):
            yield row
            if done == 2:
                for worker in multiprocessing.active_children():
                    os.kill(int(worker.pid or 0), signal.SIGABRT)

    monkeypatch.setattr(module, "drive_episodes", killing)
    words = ["evaluate", "idm", "--vehicles", "30", "--episodes", "40", *TINY, "--out"]
    assert cli.main([*words, str(tmp_path / "killed.csv"), "--jobs", "2"]) == 0
    monkeypatch.undo()
    assert cli.main([*words, str(tmp_path / "whole.csv")]) == 0
    assert (tmp_path / "killed.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()


ABORTED = """
import os, sys
from drl_av import cli
from drl_av.drivers import policy_file, registry
from drl_av.env import highway
from drl_av.simulation.simulation import Simulation
from drl_av.evaluation import episodes
cli.evaluate.SAVE_EVERY_S, drive, driven = 0.0, episodes.drive, iter(range(9))

def aborting(*arguments):
    if next(driven) == 3:
        os.abort()
    return drive(*arguments)

episodes.drive = aborting
sys.exit(cli.main(sys.argv[1:]))
"""


def test_rows_of_before_sumo_took_the_only_process_along_are_kept(tmp_path: Path) -> None:
    out = tmp_path / "rows.csv"
    words = ["evaluate", "idm", "--vehicles", "3", "--episodes", "9", *TINY, "--out", str(out)]
    assert python("-c", ABORTED, *words).returncode == -signal.SIGABRT
    assert len(out.read_text().splitlines()) == 1 + 3


def test_interval_of_a_known_sample() -> None:
    """2, 4, 4, 5, 10: mean 5, variance 36 / 4 = 9, so 2.776445 * 3 / sqrt(5) = 3.724992."""
    mean = mean_with_interval([2, 4, 4, 5, 10])
    assert mean.value == 5.0
    assert mean.half_width == pytest.approx(3.724992, abs=1e-6)
    assert str(mean) == f"{mean}" == "5.00 ± 3.72"
    assert f"{mean:.1f}" == "5.0 ± 3.7"
    assert f"{Mean(-0.004, 0.06)}" == "0.00 ± 0.06"


def test_one_episode_has_no_interval(tmp_path: Path) -> None:
    assert mean_with_interval([3.0]) == Mean(3.0, math.inf)
    assert str(mean_with_interval([3.0])) == "3.00"
    write_summaries(tmp_path / "one.json", {"by_vehicles": summarize([RESULT])})
    [summary] = json.loads((tmp_path / "one.json").read_text())["by_vehicles"]
    assert summary["speed_m_s"] == {"mean": 20.0, "ci95_half_width": None}


def test_summary_counts_hits_and_groups_by_vehicles_driver_and_check() -> None:
    rows = [
        RESULT,
        replace(RESULT, seed=1, mean_speed_m_s=22.0, collided=True, ego_hit=True),
        replace(RESULT, seed=2, mean_speed_m_s=24.0, collided=True),
        replace(RESULT, safety_check="permit_all"),
        replace(RESULT, vehicles=1),
    ]
    first, *others = summarize(rows)
    with pytest.raises(DrlAvError, match="drove seed 0 among 5 vehicles twice"):
        summarize([*rows, RESULT])
    assert (first.episodes, first.collisions, first.ego_hits) == (3, 2, 1)
    assert first.speed_m_s.value == 22.0
    assert [(s.vehicles, s.safety_check, s.episodes) for s in others] == [
        (5, "permit_all", 1),
        (1, "paper", 1),
    ]


def test_processes_do_not_share_a_file_that_sumo_writes(tmp_path: Path, capsys: Capsys) -> None:
    file, runs = tmp_path / "fcd.xml", tmp_path / "runs"
    commands = ["evaluate idm --vehicles 1 --episodes 2", f"train --seeds 1,2 --out {runs}"]
    writing, reading = tmp_path / "writing.add.xml", tmp_path / "reading.add.xml"
    for detectors, output in ((writing, file), (reading, "NUL")):
        loop = f'<inductionLoop id="loop" lane="e0_1" pos="50" period="1" file="{output}"/>'
        detectors.write_text(f"<additional>{loop}</additional>")
    options = f"--fcd-output={file}", f"--device.ssm.file {file}", f"-a {reading},{writing}"
    states = f"--save-state.times 1 --save-state.prefix {file}"
    options += states, f"-l {file}", f"-C {file}", f"--device.rerouting.output {file}"
    options += ("--device.ssm.probability 1",)
    for words, option in product(commands, options):
        assert cli.main([*words.split(), "--jobs", "2", f"--sumo-options={option}"]) == 1
        assert "several processes would write one file" in capsys.readouterr().err
    assert not file.exists()
    assert not runs.exists()
    harmless = f"--additional-files={reading} --device.ssm.probability 0"
    shared = ["--jobs", "2", f"--sumo-options={harmless}"]
    assert cli.main([*commands[0].split(), *shared, *TINY]) == 0


def test_an_interrupted_evaluation_continues_and_drives_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    driven = list[int]()

    def drive(env: Any, driver: Any, name: str, seed: int, *others: Any) -> EpisodeResult:
        if len(driven) == 3 and 99 not in driven:
            driven.append(99)
            signal.raise_signal(signal.SIGTERM)
        driven.append(seed)
        return replace(RESULT, driver=name, seed=seed, vehicles=5)

    monkeypatch.setattr(module, "drive", drive)
    out, summary = tmp_path / "rows.csv", tmp_path / "rows.json"
    summary.write_text("the old summary\n")
    words = ["evaluate", "idm", "--vehicles", "5", "--episodes", "9"]
    words += ["--out", str(out), "--json", str(summary)]
    assert cli.main(words) == 130
    assert len(out.read_text().splitlines()) == 1 + 3
    assert summary.read_text() == "the old summary\n"
    printed = capsys.readouterr()
    assert "drl-av: interrupted after 3 episodes." in printed.err
    assert f"{summary} is unchanged." in printed.err
    assert "3 episodes each" in printed.out
    assert cli.main(words) == 0
    assert driven == [0, 1, 2, 99, 3, 4, 5, 6, 7, 8]
    assert [row["seed"] for row in read_rows(out)] == list("012345678")
    assert "by_vehicles" in json.loads(summary.read_text())
    assert "9 episodes each" in capsys.readouterr().out
    assert cli.main([*words, "--criticality"]) == 1
    assert "other settings, columns or drivers (column c" in capsys.readouterr().err
    facts = json.loads(out.with_suffix(".provenance.json").read_text())
    made = facts["seeds"], facts["engine"], facts["step_length_s"]
    assert made == ("0 to 8", "loky", 0.5)
    before = out.read_bytes()
    assert cli.main([*words, "--safety-check", "permit_all"]) == 1
    assert "rows.csv was made with other settings" in capsys.readouterr().err
    assert out.read_bytes() == before
    assert cli.main([*words, "--driver", "idm-sumo", "--episodes", "2"]) == 0  # others join
    assert driven[10:] == [0, 1]
    assert out.read_bytes().startswith(before.splitlines()[0])
    assert len(out.read_text().splitlines()) == 1 + 9 + 2
    made = out.with_suffix(".provenance.json").read_bytes()
    monkeypatch.setattr(module, "drive", lambda *given: signal.raise_signal(signal.SIGTERM))
    assert cli.main([*words, "--driver", "drl_av.drivers.rule_based:IdmDriver"]) == 130
    assert out.with_suffix(".provenance.json").read_bytes() == made  # no driver without a row


def test_seeds_of_training_are_not_evaluated_on() -> None:
    with pytest.raises(ConfigError, match="1000000 on belong to training"):
        Evaluation(Setup(SHORT, find_drivers(["idm"])), (1,), range(999_999, 1_000_001))
    Evaluation(Setup(SHORT, find_drivers(["idm"])), (1,), range(999_999, 1_000_000))


def test_the_overall_statistics_compare_each_driver_with_the_fastest_baseline() -> None:
    speeds = {
        ("idm", 5): (20.0, 22.0),
        ("idm", 10): (10.0, 12.0),
        ("slow", 5): (28.0, 2.0),
        ("slow", 10): (1.0, 1.0),
        ("mine", 10): (13.0, 11.0),  # its rows come in another order
        ("mine", 5): (22.0, 21.0),
    }
    rows = [
        replace(RESULT, driver=driver, vehicles=vehicles, seed=seed, mean_speed_m_s=speed)
        for (driver, vehicles), both in speeds.items()
        for seed, speed in enumerate(both)
    ]
    idm, slow, mine = overall(rows, ["slow", "idm", "absent"])
    assert (idm.driver, idm.over, idm.improvement) == ("idm", None, None)
    assert (slow.over, mine.over, mine.episodes) == ("idm", "idm", 4)
    # of 22 and 21 against 20 and 22: 3 pairs and half a tie less; of 13 and 11 against 10 and 12: 3
    assert mine.improvement.value == (2.5 / 4 + 3 / 4) / 2
    assert mine.speed_m_s.value == (13 + 21) / 2  # 11, 13, 21 and 22 without the outer two
    profile = mine.share_faster_than_m_s
    assert (profile[10], profile[11], profile[21], profile[22]) == (1.0, 0.75, 0.25, 0.0)
    assert max(profile) == 22
    assert [each.over for each in overall(rows, [])] == [None] * 3


def test_the_json_has_the_statistics_by_vehicles_and_overall(tmp_path: Path) -> None:
    rows = [RESULT, replace(RESULT, driver="mine", mean_speed_m_s=21.0)]
    parts = {"by_vehicles": summarize(rows), "overall": overall(rows, ["idm"])}
    write_summaries(tmp_path / "both.json", parts)
    found = json.loads((tmp_path / "both.json").read_text())
    assert [each["vehicles"] for each in found["by_vehicles"]] == [5, 5]
    idm, mine = found["overall"]
    assert idm["improvement"] is None
    assert mine["speed_m_s"] == {"value": 21.0, "ci95": [None, None]}
    assert (mine["over"], mine["improvement"]["value"]) == ("idm", 1.0)
    assert mine["share_faster_than_m_s"]["20"] == 1.0
