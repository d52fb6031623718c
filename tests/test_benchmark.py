import importlib
import json
from contextlib import closing
from pathlib import Path

from programs import python

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.highways import StraightDescription

TOOLS = Path(__file__).parents[1] / "tools"


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


def test_a_world_of_the_twin_takes_as_much_memory_as_its_arrays(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    measure = importlib.import_module("measure_twin")
    few, many = (measure.kib_a_world(vehicles, 2) for vehicles in (5, 30))
    # 27 rows of x, 6 of the scene and 2 of before, 8 bytes each, and 24 of z, 4 each, a vehicle
    assert many - few == 25 * ((27 + 6 + 2) * 8 + 24 * 4) / 1024
