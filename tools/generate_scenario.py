"""Writes a scenario folder, exactly as ``drl-av scenario DIR`` does."""

import sys

from drl_av.cli import main

if __name__ == "__main__":
    sys.exit(main(["scenario", *sys.argv[1:]]))
