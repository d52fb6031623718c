"""Measures what the twin costs beside its decisions: time to compile, and memory per world.

    python tools/measure_twin.py

The time is that of the first reset and decision with an empty cache of machine code, less that of
the same with a full one, each in a process of its own. The memory is that of the arrays.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from drl_av.config import Config
from drl_av.env.vector import TwinVectorEnv
from verification.program import made_by

FIRST = """
import time
import drl_av.env.vector as vector
begun = time.perf_counter()
worlds = vector.TwinVectorEnv(1)
worlds.reset(seed=1)
worlds.step([0])
print(time.perf_counter() - begun)
"""


def first_decision_s(cache: str) -> float:
    """Return the time of the first reset and decision in a new process, by this cache, seconds."""
    command, settings = [sys.executable, "-c", FIRST], os.environ | {"NUMBA_CACHE_DIR": cache}
    done = subprocess.run(command, env=settings, capture_output=True, text=True, check=True)
    return float(done.stdout)


def kib_a_world(vehicles: int, worlds: int) -> float:
    """Return the size of the arrays of a world with so many vehicles besides the ego, KiB."""
    config = Config().updated("traffic", vehicles_min=vehicles, vehicles_max=vehicles)
    envs = TwinVectorEnv(worlds, config=config, threads=1)
    envs.reset(seed=1)
    arrays: list[np.ndarray] = [*envs.worlds, *envs.episodes]
    envs.close()
    return sum(array.nbytes for array in arrays) / worlds / 1024


def main() -> None:
    """Print the time to compile, and the memory per world for a few numbers of vehicles."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=256, help="(default: 256)")
    options = parser.parse_args()
    begun_s = time.monotonic()
    with tempfile.TemporaryDirectory() as cache:
        empty_s, full_s = first_decision_s(cache), first_decision_s(cache)
    print(f"time to compile                  {empty_s - full_s:8.1f} s")
    print(f"first decision, compiled before  {full_s:8.1f} s")
    for vehicles in (5, 30, 100):
        name = f"a world with {vehicles} vehicles"
        print(f"{name:<32} {kib_a_world(vehicles, options.worlds):8.1f} KiB")
    print(made_by(time.monotonic() - begun_s))


if __name__ == "__main__":
    main()
