"""Counts the files of drl_av whose functions a step, a reset, a training and an evaluation call.

python tools/files_entered.py [--names]
"""

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from types import FrameType

import drl_av.cli
from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.learning.algorithm_1 import build_training

PACKAGE = str(Path(drl_av.__file__).parent) + os.sep


@contextmanager
def files_entered() -> Iterator[set[str]]:
    """Collect the files whose functions are called within the block, without module bodies."""
    files: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_name != "<module>" and code.co_filename.startswith(PACKAGE):
            files.add(code.co_filename.removeprefix(PACKAGE))

    sys.setprofile(note)
    try:
        yield files
    finally:
        sys.setprofile(None)


def main() -> None:
    """Print the number of files of each, and with ``--names`` the files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--names", action="store_true", help="also print the names of the files")
    options, counts = parser.parse_args(), dict[str, set[str]]()
    with closing(HighwayEnv()) as env:
        env.reset(seed=1, options={"vehicles": 20})  # the first reset starts SUMO
        with files_entered() as counts["reset"]:
            env.reset(seed=2, options={"vehicles": 20})
        with files_entered() as counts["step"]:
            for action in (0, 1, 3, 4, 8):
                env.step(action)
    config = Config().updated("simulation", decisions_per_episode=20)
    with closing(HighwayEnv(config=config)) as env:
        training = build_training(env)
        training.run_episode()
        with files_entered() as counts["training episode"]:
            training.run_episode()
    words = ["evaluate", "pretrained", "idm", "--episodes", "1", "--vehicles", "5"]
    silent = StringIO()
    with redirect_stdout(silent), redirect_stderr(silent), files_entered() as counts["evaluate"]:
        drl_av.cli.main(words)
    for name, files in counts.items():
        print(f"{name:17} {len(files):3}", *(sorted(files) if options.names else ()))


if __name__ == "__main__":
    main()
