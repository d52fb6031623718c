import importlib
import json
import sys
import types
from contextlib import ExitStack, closing
from pathlib import Path

from programs import python

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.highways import StraightDescription

TOOLS = Path(__file__).parents[1] / "tools"


def small_env():
    config = Config().updated("traffic", vehicles_min=3, vehicles_max=3)
    return HighwayEnv(config=config.updated("simulation", decisions_per_episode=5))


def test_the_long_road_has_500_vehicles_by_its_flow(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(TOOLS))
    rows = importlib.import_module("benchmark_rows")
    write_scenario(tmp_path / "long", rows.long_road())
    config = rows.crowded(rows.ON_STRAIGHT).updated("simulation", scenario=str(tmp_path / "long"))
    with closing(HighwayEnv(config=config)) as env:
        assert env.simulation.fleet.default_vehicle_count == rows.ON_STRAIGHT == 500
    assert "straight" in importlib.import_module("benchmark").ROWS


def test_bare_libsumo_adds_the_vehicles_that_enter_an_open_road(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(TOOLS))
    drives = importlib.import_module("benchmark_drives")
    write_scenario(tmp_path / "busy", StraightDescription(flow_per_h=2000.0, length_m=400.0))
    config = Config().updated("traffic", vehicles_min=79, vehicles_max=79, truck_share=0.3)
    config = config.updated("simulation", scenario=str(tmp_path / "busy"))
    with closing(HighwayEnv(config=config)) as env:
        calls = drives.recorded_calls(env, {7: [0] * 12})
        names = [call.func.__name__ for call in calls[7]]
        # 3 lanes of 2,000 vehicles/h for 12 s are 20 vehicles
        assert 15 <= names.count("add") <= 25
        assert 0 < names.count("setShapeClass") < names.count("add")
        driven = positions(env)
        drives.step_bare(env, calls)
        assert positions(env) == driven


def positions(env: HighwayEnv) -> list[tuple[float, float]]:
    vehicle = env.simulation._sumo.vehicle
    return [vehicle.getPosition(name) for name in vehicle.getIDList()]


def test_bare_libsumo_repeats_the_commands_of_the_environment_beside_another_one(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    drives = importlib.import_module("benchmark_drives")
    with closing(small_env()) as other, closing(small_env()) as env:
        other.reset(seed=1)
        env.reset(seed=7)
        calls = drives.recorded_calls(env, {7: [5, 5, 5, 5, 5]})
        # five decisions of two SUMO steps; the ego's speed is set at the start of each step
        names = [call.func.__name__ for call in calls[7]]
        assert names.count("simulationStep") == 10
        assert names.count("setSpeed") == 10
        driven = positions(env)
        assert drives.step_bare(env, calls) > 0
        assert positions(env) == driven


def test_what_cannot_be_measured_says_what_it_needs_and_the_rest_is_measured():
    program = f"""
import json, sys
sys.path.insert(0, {str(TOOLS)!r})
class Without:
    def find_spec(self, name, path=None, target=None):
        if name in ("envpool", "highway_env", "torch", "stable_baselines3"):
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Without())
import benchmark, benchmark_rows
benchmark.ROWS["env"] = lambda seeds, stack: [benchmark_rows.Row("mine", lambda: 2.0, lambda: 1.0)]
sys.argv[1:] = ["env", "envpool", "highway-env", "step", "train", "--rounds", "1"]
sys.argv += ["--episodes", "1", "--json"]
benchmark.main()
"""
    done = python("-c", program)
    assert done.returncode == 0, done.stderr
    assert [row["name"] for row in json.loads(done.stdout)] == ["mine"]
    for line in (
        "envpool: not measured, it needs envpool: pip install 'drl-av[benchmark]'",
        "highway-env: not measured, it needs highway_env: pip install 'drl-av[benchmark]'",
        "step: not measured, it needs torch: pip install 'drl-av[train]'",
        "train: not measured, it needs torch: pip install 'drl-av[train]'",
    ):
        assert line in done.stderr.splitlines()


def test_a_simulated_step_of_the_twin_is_half_a_second_and_one_of_envpool_a_fifteenth(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    rows = importlib.import_module("benchmark_rows")
    made = {}

    class Pool:
        def __init__(self):
            self.config = {"simulation_frequency": 15}

        def reset(self):
            made["actions"] = []

        def step(self, actions):
            made["actions"].append(actions.tolist())

    def make(name, **settings):
        made.update(settings, name=name)
        return Pool()

    monkeypatch.setitem(sys.modules, "envpool", types.SimpleNamespace(make=make))
    monkeypatch.setattr(rows, "WORLDS", 2)
    monkeypatch.setattr(rows, "DECISIONS", 3)
    with ExitStack() as stack:
        decisions, steps = rows.envpool_rows([1_000], stack)
        assert decisions.ours() > 0
        assert decisions.beside() > 0
    assert made["actions"] == 3 * [[1, 1]]  # keep lane and speed, in each of two worlds
    assert (made["name"], made["lanes_count"], made["vehicles_count"]) == ("Highway-v0", 3, 30)
    assert (made["num_envs"], made["num_threads"]) == (2, 1)
    assert steps.ours.args[1] == 2
    assert steps.beside.args[1] == 15
    assert rows.multiplied(lambda: 10.0, steps.beside.args[1]) == 150.0


def test_a_world_of_the_twin_takes_as_much_memory_as_its_arrays(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    measure = importlib.import_module("measure_twin")
    few, many = (measure.kib_a_world(vehicles, 2) for vehicles in (5, 30))
    # 27 rows of x, 6 of the scene and 2 of before, 8 bytes each, and 26 of z, 4 each, a vehicle
    assert many - few == 25 * ((27 + 6 + 2) * 8 + 26 * 4) / 1024
