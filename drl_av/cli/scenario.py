"""The verb ``scenario``: writes a scenario folder, which SUMO alone can open too."""

import argparse
from pathlib import Path

from drl_av.cli.arguments import whole


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder to write; must be new")
    parser.add_argument(
        "--circumference-m", type=float, default=500.0, metavar="M", help="length of a lane, metres"
    )
    parser.add_argument("--lanes", type=whole(1), default=3, metavar="N", help="number of lanes")
    parser.add_argument(
        "--lane-width-m", type=float, default=3.8, metavar="M", help="width of a lane, metres"
    )
    parser.add_argument(
        "--barricade",
        type=whole(0),
        nargs="+",
        default=(),
        metavar="LANE",
        help="lanes to close; 0 is the rightmost (default: none)",
    )


def scenario(options: argparse.Namespace) -> int:
    """Write the folder, and print the command that opens it; return the exit status 0."""
    from drl_av.traffic.scenario import ScenarioDescription, write_scenario

    description = ScenarioDescription(
        circumference_m=options.circumference_m,
        lanes=options.lanes,
        lane_width_m=options.lane_width_m,
        barricaded_lanes=tuple(options.barricade),
    )
    write_scenario(options.folder, description)
    print(f"{options.folder}: open it with sumo-gui -c {options.folder / 'highway.sumocfg'}")
    return 0
