"""Measures whether resident memory grows by 5 % over thousands of resets; exit status 1 if so.

    python tools/measure_memory.py --resets 5000 --environments 2

The driver ``random`` makes a few decisions after each reset. Growth is measured from the end of
the first 200 resets, when all caches are full. The program reads /proc and so needs Linux.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

from drl_av.drivers.rule_based import RandomDriver
from drl_av.env.highway import HighwayEnv
from drl_av.errors import pluralize
from verification.program import made_by

CALM = {"traffic": {"kind": "calm"}}
SEEDS = 3_000
"""First traffic seed of the episodes."""
MOST_GROWTH = 0.05


def resident_bytes() -> int:
    """Return the resident memory of this process in bytes."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def resets(env: HighwayEnv, number: int, vehicles: int, decisions: int) -> Iterator[int]:
    """Reset ``number`` times, each time with some random decisions; yield the number of resets."""
    driver = RandomDriver()
    for done in range(1, number + 1):
        observation, _ = env.reset(seed=SEEDS + done, options={"vehicles": vehicles})
        driver.start(SEEDS + done)
        for _ in range(decisions):
            observation, _, terminated, _, _ = env.step(driver.act(env.scene, observation).number)
            if terminated:
                break
        yield done


def main() -> int:
    """Reset the environments, print the memory's growth; return 1 if it is 5 % or more, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--resets", type=int, default=5_000, help="resets that are measured (default: 5000)"
    )
    parser.add_argument(
        "--environments", type=int, default=1, help="number of them, reset in turn (default: 1)"
    )
    parser.add_argument(
        "--warm-up", type=int, default=200, help="resets before these (default: 200)"
    )
    parser.add_argument("--vehicles", type=int, default=30, help="beside the ego (default: 30)")
    parser.add_argument("--decisions", type=int, default=3, help="after each reset (default: 3)")
    options = parser.parse_args()
    begun_s = time.monotonic()
    reported = {options.warm_up + round(options.resets * part / 10) for part in range(11)}
    held = {}
    total = options.warm_up + options.resets
    with ExitStack() as stack:
        envs = [
            stack.enter_context(closing(HighwayEnv(config=CALM)))
            for _ in range(options.environments)
        ]
        rounds = [resets(env, total, options.vehicles, options.decisions) for env in envs]
        for done, *_ in zip(*rounds, strict=True):
            if done in reported:
                held[done] = resident_bytes()
                print(f"{done:>7} resets {held[done] / 2**20:8.1f} MiB", flush=True)
    growth = held[total] / held[options.warm_up] - 1
    print(
        f"growth over {pluralize(options.resets, 'reset')} of "
        f"{pluralize(options.environments, 'environment')}: {growth:+.2%}"
    )
    print(made_by(time.monotonic() - begun_s))
    return int(growth >= MOST_GROWTH)


if __name__ == "__main__":
    sys.exit(main())
