"""Simulations side by side in one process, each as if it were alone."""

import gc
import multiprocessing
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from itertools import zip_longest
from multiprocessing.connection import Connection
from pathlib import Path

import libsumo
import pytest
import traci
from programs import python

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.errors import SimulationError
from drl_av.simulation import start_sumo
from drl_av.simulation.start_sumo import Instance, acquire

CONFIG = Config().updated("simulation", decisions_per_episode=12)
INSTALLED = Path(libsumo.__file__).parent
Make = Callable[[], HighwayEnv]


@pytest.fixture
def make(stack: ExitStack) -> Make:
    """Makes environments, and closes them after the test."""
    return lambda: stack.enter_context(
        closing(HighwayEnv(config=CONFIG, safety_check="permit_all"))
    )


@pytest.fixture
def no_copies_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a process whose environments were one at a time so far."""
    gc.collect()
    assert not libsumo.isLoaded()
    monkeypatch.setattr(start_sumo, "_instances", [Instance(libsumo)])


def started(make: Make, number: int) -> list[HighwayEnv]:
    """So many environments, each at the start of the same episode."""
    envs = [make() for _ in range(number)]
    for env in envs:
        env.reset(seed=1, options={"vehicles": 2})
    return envs


def states(env: HighwayEnv) -> bytes:
    """Where all vehicles are and how they move, to the last bit."""
    seen = env.scene.snapshot
    numbers = (seen.s_m, seen.y_m, seen.speed_m_s, seen.lateral_speed_m_s)
    return b"".join(number.tobytes() for number in numbers)


def drive(env: HighwayEnv, seed: int) -> Iterator[bytes]:
    """Drive an episode; yields the states before each decision and at the end."""
    env.reset(seed=seed, options={"vehicles": 20})
    over = False
    while not over:
        yield states(env)
        *_, collided, truncated, _ = env.step((seed + 5 * env.decisions) % 12)
        over = collided or truncated
    yield states(env)


def alone(seed: int) -> list[bytes]:
    with closing(HighwayEnv(config=CONFIG, safety_check="permit_all")) as env:
        return [*drive(env, seed)]


def interleaved(*episodes: Iterator[bytes]) -> list[list[bytes]]:
    """Episodes of which each drives a decision in turn."""
    rounds = [*zip_longest(*episodes)]
    return [[seen for seen in episode if seen] for episode in zip(*rounds, strict=True)]


def test_interleaved_episodes_are_those_driven_alone_also_after_one_is_closed(make: Make) -> None:
    wanted = [alone(seed) for seed in (1, 2, 3)]
    assert {len(episode) for episode in wanted} != {1}
    a, b, c = make(), make(), make()
    assert interleaved(drive(a, 1), drive(b, 2), drive(c, 3)) == wanted
    begun = drive(c, 3)
    first = [next(begun), next(begun)]
    a.close()
    assert interleaved(drive(make(), 1), drive(b, 2)) == wanted[:2]
    assert [*first, *begun] == wanted[2]


def test_a_program_that_reads_the_files_of_all_modules_finds_the_installed_library(
    make: Make, no_copies_yet: None
) -> None:
    copy = started(make, 2)[1].simulation._sumo
    assert copy.__name__ != "libsumo"
    assert copy._libsumo.__file__ == copy._libsumo.__spec__.origin == libsumo._libsumo.__file__
    files = [getattr(module, "__file__", None) or "" for module in [*sys.modules.values()]]
    assert not [file for file in files if file.startswith(("/proc", "/dev"))]


def test_the_installed_package_comes_first_and_closed_environments_leave_their_copy(
    make: Make, no_copies_yet: None
) -> None:
    envs = started(make, 16)
    first = [env.simulation._sumo.__name__ for env in envs]
    assert first[0] == "libsumo"
    assert len({*first}) == 16
    for env in envs:
        env.step(0)
        env.close()
    assert [env.simulation._sumo.__name__ for env in started(make, 16)] == first


def test_an_environment_that_is_forgotten_leaves_its_copy(make: Make, no_copies_yet: None) -> None:
    make().reset(seed=1)
    for _ in range(3):
        HighwayEnv(config=CONFIG).reset(seed=1)
        gc.collect()
    assert len(start_sumo._instances) == 2


def test_every_copy_raises_the_errors_that_a_program_of_libsumo_expects(make: Make) -> None:
    envs = started(make, 2)
    for env in envs:
        with pytest.raises(libsumo.TraCIException, match="'absent' is not known"):
            env.simulation._sumo.vehicle.getSpeed("absent")
        assert env.simulation._sumo.TraCIException is libsumo.TraCIException
    assert traci.exceptions.TraCIException is libsumo.TraCIException
    for env in envs:
        wanted = states(env)
        env.simulation._sumo.close()
        with pytest.raises(SimulationError, match="SUMO ended on its own"):
            env.step(0)
        env.reset(seed=1, options={"vehicles": 2})
        assert states(env) == wanted


def test_a_closed_simulation_does_not_drive_another_s(make: Make, no_copies_yet: None) -> None:
    closed, other = make(), make()
    with pytest.raises(SimulationError, match="reset it first"):
        closed.simulation.advance(())
    closed.reset(seed=1)
    closed.close()
    other.reset(seed=1)  # in what the first has left
    with pytest.raises(SimulationError, match="reset it first"):
        closed.simulation.advance(())
    closed.close()
    assert other.simulation._sumo is libsumo
    other.step(0)


def test_a_simulation_of_the_user_s_own_program_is_left_alone(
    make: Make, no_copies_yet: None
) -> None:
    env = make()
    network = str(env.simulation.scenario.network_file)
    libsumo.start(["sumo", "--net-file", network, "--no-step-log", "true"])
    try:
        libsumo.simulationStep(7.0)
        assert [*drive(env, 2)]
        assert libsumo.simulation.getTime() == 7.0
    finally:
        libsumo.close()


def test_threads_drive_each_its_own() -> None:
    seeds = [1, 2, 3, 1, 2, 3]
    wanted = [alone(seed) for seed in seeds]
    with ThreadPoolExecutor(3) as threads:
        assert [*threads.map(alone, seeds)] == wanted


def in_a_child(sender: Connection, begun: list[Iterator[bytes]]) -> None:
    sender.send(interleaved(*begun, drive(HighwayEnv(config=CONFIG), 3)))


def test_a_forked_child_drives_on_and_so_does_its_parent(make: Make) -> None:
    begun = [drive(make(), 1), drive(make(), 2)]
    first = [[next(episode)] for episode in begun]
    receiver, sender = multiprocessing.Pipe(duplex=False)
    context = multiprocessing.get_context("fork")
    child = context.Process(target=in_a_child, args=(sender, begun))
    child.start()
    of_child = receiver.recv()
    child.join(60)
    assert child.exitcode == 0
    of_parent = interleaved(*begun, drive(make(), 3))
    wanted = [alone(1), alone(2)]
    for driven in (of_child, of_parent):
        assert [a + b for a, b in zip(first, driven[:2], strict=True)] == wanted
    assert len(of_child[2]) > 1


KILLED = """
import os, shutil, signal
from drl_av.env.highway import HighwayEnv
def copy_and_be_killed(source, target, copy=shutil.copyfile):
    copy(source, target)
    os.kill(os.getpid(), signal.SIGKILL)
envs = [HighwayEnv() for _ in range(3)]
envs[0].reset(seed=1)
envs[1].reset(seed=1)
print("driving", flush=True)
shutil.copyfile = copy_and_be_killed
envs[2].reset(seed=1)
"""


def test_a_killed_process_leaves_no_copy_behind(tmp_path: Path) -> None:
    before = {*INSTALLED.iterdir()}
    ended = python("-c", KILLED, TMPDIR=str(tmp_path))
    assert (ended.returncode, ended.stdout) == (-signal.SIGKILL, "driving\n"), ended.stderr
    assert [*tmp_path.iterdir()] == []
    assert {*INSTALLED.iterdir()} == before


def test_where_open_files_have_no_path_a_copy_is_a_file_until_it_is_loaded(
    make: Make, no_copies_yet: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {*INSTALLED.iterdir()}
    monkeypatch.setattr(start_sumo, "OPEN_FILES", Path("/no/such/folder"))
    wanted = [alone(1), alone(2)]
    assert interleaved(drive(make(), 1), drive(make(), 2)) == wanted
    assert {*INSTALLED.iterdir()} == before


def test_if_libsumo_cannot_be_copied_the_error_of_the_second_names_a_remedy(
    make: Make, no_copies_yet: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*files: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(shutil, "copyfile", full)
    first, second = make(), make()
    wanted = alone(2)
    begun = drive(first, 1)
    next(begun)
    with pytest.raises(SimulationError, match=r"copy libsumo for another \(No space") as caught:
        second.reset(seed=2)
    for word in ("'async'", "SubprocVecEnv(..., start_method='spawn')", "--vec-env subproc"):
        assert word in str(caught.value)
    assert str(caught.value).count(". ") == 0
    assert [*begun]  # the first is not disturbed
    first.close()
    assert [*drive(second, 2)] == wanted


SHARED = """
import os, sys
from contextlib import contextmanager
from drl_av.env.highway import HighwayEnv
from drl_av.errors import SimulationError
from drl_av.simulation import start_sumo
@contextmanager
def linked(file, folder, number):
    os.symlink(file, sys.argv[2])
    yield sys.argv[2]
if sys.argv[1] == "RTLD_GLOBAL":
    sys.setdlopenflags(os.RTLD_NOW | os.RTLD_GLOBAL)
else:
    start_sumo._copied_file = linked
first, second = HighwayEnv(), HighwayEnv()
first.reset(seed=1)
try:
    second.reset(seed=1)
except SimulationError as error:
    print(error)
first.step(0)
"""


@pytest.mark.parametrize("reason", ["RTLD_GLOBAL", "the copy is not independent"])
def test_a_copy_that_would_share_the_variables_is_refused(reason: str, tmp_path: Path) -> None:
    ended = python("-c", SHARED, reason, tmp_path / "_libsumo.so")
    assert ended.returncode == 0, ended.stderr
    assert reason in ended.stdout


def test_sumo_gui_is_open_once(monkeypatch: pytest.MonkeyPatch) -> None:
    window = acquire(gui=True)
    with pytest.raises(SimulationError, match="close the other one first"):
        acquire(gui=True)
    window.release()
    acquire(gui=True).release()
