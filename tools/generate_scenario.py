"""Write a scenario folder; the same as ``drl-av scenario DIR``."""

import sys

from drl_av.cli import main

if __name__ == "__main__":
    sys.exit(main(["scenario", *sys.argv[1:]]))
