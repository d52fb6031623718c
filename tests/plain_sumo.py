"""Scenario folders in plain SUMO, without drl-av."""

import os
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

from drl_av.scenarios.netconvert import program


def run_sumo(*words: object) -> None:
    """Run SUMO, which must have nothing to complain about."""
    home = program("netconvert").parents[1]
    command = [home / "bin" / "sumo", *map(str, words), "--no-step-log"]
    environment = os.environ | {"SUMO_HOME": str(home), "PROJ_LIB": str(home / "data" / "proj")}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stderr) == (0, "")


def states(folder: Path, end_s: int, *options: str) -> ET.Element:
    """The moments of a scenario, each with the vehicles on its road."""
    return _output(folder, end_s, "--fcd-output", *options)


def trips(folder: Path, end_s: int) -> list[dict[str, str]]:
    """The trips that have ended in a scenario."""
    return [trip.attrib for trip in _output(folder, end_s, "--tripinfo-output").iter("tripinfo")]


def _output(folder: Path, end_s: int, option: str, *options: str) -> ET.Element:
    file = folder.with_name(f"{folder.name}.xml")
    run_sumo("-c", folder / "highway.sumocfg", "--end", end_s, option, file, *options)
    return ET.parse(file).getroot()
