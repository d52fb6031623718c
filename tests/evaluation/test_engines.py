"""Engines: a job that is killed is begun again, but not for ever; none outlives who asked."""

import os
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterable
from pathlib import Path

import pytest
from runs import Capsys
from shown import ROOT

from drl_av.errors import DrlAvError, RunError, SimulationError
from drl_av.evaluation import engines
from drl_av.evaluation.engines import RETRIES, on_ray, on_this_machine
from studies.__main__ import main


def test_jobs_that_kill_their_process_each_time_are_given_up(tmp_path: Path) -> None:
    def suicidal(folder: str) -> None:
        import os
        import signal
        from pathlib import Path

        (Path(folder) / str(os.getpid())).touch()
        os.kill(os.getpid(), signal.SIGKILL)

    with pytest.raises(SimulationError, match=r"killed 4 times.*fewer --jobs"):
        list(on_this_machine(suicidal, [str(tmp_path)], 1))
    assert len(list(tmp_path.iterdir())) == RETRIES + 1


def test_what_a_job_raises_is_raised_and_not_tried_again(tmp_path: Path) -> None:
    def failing(folder: str) -> None:
        import os
        from pathlib import Path

        from drl_av.errors import RunError

        (Path(folder) / str(os.getpid())).touch()
        raise RunError("The disk is full.")

    with pytest.raises(RunError, match="The disk is full"):
        list(on_this_machine(failing, [str(tmp_path)], 1))
    assert len(list(tmp_path.iterdir())) == 1


def test_processes_end_with_the_engine(tmp_path: Path) -> None:
    def endless(folder: str) -> None:
        import os
        import time
        from pathlib import Path

        (Path(folder) / str(os.getpid())).touch()
        time.sleep(600)

    engine = on_this_machine(endless, [str(tmp_path)] * 2, 2)
    while not list(tmp_path.iterdir()):
        assert next(engine) == []
    engine.close()
    _await_end(int(file.name) for file in tmp_path.iterdir())


ENGINE = "list(engines.on_this_machine(endless, [folder], 1))"
ABLATION = """
from studies import ablation
ablation.drive_rule, given = endless, Namespace(runs=Path(folder), out=Path("none.csv"), jobs=1)
ablation.complete(given, ablation.Row, [("large", 0)], None, None)
"""


@pytest.mark.parametrize("asks", [ENGINE, ABLATION])
def test_processes_end_with_who_asked_though_that_was_killed(tmp_path: Path, asks: str) -> None:
    program = f"""
from argparse import Namespace
from pathlib import Path
from drl_av.evaluation import engines
def endless(folder, *rest):
    import os, pathlib, time
    (pathlib.Path(folder) / str(os.getpid())).touch()
    time.sleep(600)
folder = {str(tmp_path)!r}
{asks}
"""
    asker = subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.DEVNULL)
    while not list(tmp_path.iterdir()):
        assert asker.poll() is None
        time.sleep(0.05)
    asker.kill()
    asker.wait()
    _await_end(int(file.name) for file in tmp_path.iterdir())


def _await_end(pids: Iterable[int]) -> None:
    deadline = time.monotonic() + 30
    for pid in pids:
        while Path(f"/proc/{pid}").exists():
            assert time.monotonic() < deadline
            time.sleep(0.05)


def test_missing_ray_is_reported_before_anything_is_driven(
    monkeypatch: pytest.MonkeyPatch, here: Path, capsys: Capsys
) -> None:
    monkeypatch.setattr(engines, "find_spec", lambda name: None)
    with pytest.raises(DrlAvError, match=r"pip install 'drl-av\[ray\]'"):
        next(on_ray(print, [], 1))
    small = ["--episodes", "1", "--out", "results"]
    assert main(["check", "--engine", "ray", *small]) == 1
    assert capsys.readouterr().err.startswith("studies: Ray is not installed: pip install")
    assert not list(here.iterdir())


@pytest.mark.ray
@pytest.mark.parametrize(
    ("address", "reason"), [("nonsense", "Invalid address"), ("127.0.0.1:1", "no answer in 0.5 s")]
)
def test_an_address_without_a_cluster_is_one_sentence(
    address: str, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_ADDRESS", address)
    monkeypatch.setattr(engines, "JOIN_S", 20.0 if address == "nonsense" else 0.5)
    with pytest.raises(DrlAvError, match=f"RAY_ADDRESS='{address}' \\({reason}.*unset") as error:
        next(on_ray(print, [], 1))
    assert "\n" not in str(error.value)


KILLED_RAYLET = """
import ray
import psutil
from drl_av.errors import SimulationError
from drl_av.evaluation import engines
engines.PATIENT |= {"health_check_period_ms": 500, "health_check_timeout_ms": 500}
def endless(job):
    import time
    time.sleep(600)
engine = engines.on_ray(endless, [1], 1)
next(engine)
raylets = [each for each in psutil.Process().children(True) if each.name() == "raylet"]
for raylet in raylets:
    raylet.kill()
try:
    for _ in range(30):
        next(engine)
except SimulationError as error:
    print(error)
"""


def test_make_setup_installs_ray_which_the_extra_dev_leaves_out() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    assert not [each for each in extras["dev"] if each.startswith("ray")]
    assert [each for each in extras["ray"] if each.startswith("ray")]
    assert "-e '.[dev,ray]'" in (ROOT / "Makefile").read_text()


@pytest.mark.ray
def test_a_killed_raylet_is_one_sentence() -> None:
    environment = {name: value for name, value in os.environ.items() if name != "RAY_ADDRESS"}
    ended = subprocess.run(
        [sys.executable, "-c", KILLED_RAYLET],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        timeout=300,
        check=True,
    )
    assert "Ray's own process on this machine was killed: give the same command" in ended.stdout
