import importlib
from contextlib import closing
from pathlib import Path

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv

TOOLS = Path(__file__).parents[1] / "tools"


def small_env():
    config = Config().updated("traffic", vehicles_min=3, vehicles_max=3)
    return HighwayEnv(config=config.updated("simulation", decisions_per_episode=5))


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
