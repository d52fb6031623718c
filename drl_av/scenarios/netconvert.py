"""Runs netconvert, which builds SUMO's network files, and writes XML."""

import os
import re
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

from drl_av.errors import ScenarioError, SimulationError
from drl_av.scenarios.road_description import PlacedVehicle
from drl_av.sumo_programs import missing_library, program

NETWORK_FILE = "highway.net.xml"
"""Name of the network file in a scenario folder."""
WRITE_AGAIN = "write the scenario again with: drl-av scenario DIR"
"""The advice if a file of a scenario folder is missing, damaged or changed."""
DEMO_END_S = 3600
"""Time at which the demo traffic ends."""
PRECISION = 6
"""Decimals of every length and coordinate in the network file."""


def xml_text(root: ET.Element) -> str:
    """Return an element as an indented XML document; the text is the same on every machine."""
    ET.indent(root, "    ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode") + "\n"


def vehicle_element(
    root: ET.Element, vehicle: PlacedVehicle, speed_limit_m_s: float, **place: str
) -> None:
    """Add a vehicle to ``root``, the root element of a route file with demo traffic.

    ``place`` holds the route and the attributes of the start position. A vehicle departs at most at
    its desired speed, because SUMO alone refuses vehicles that depart faster.
    """
    departs_m_s = min(vehicle.speed_m_s, vehicle.desired_speed_m_s)
    ET.SubElement(
        root,
        "vehicle",
        {
            "id": vehicle.id,
            "type": "ego" if vehicle.id == "ego" else "traffic",
            "route": place.pop("route"),
            "depart": "0",
            **place,
            "departSpeed": f"{departs_m_s:.2f}",
            "speedFactor": f"{vehicle.desired_speed_m_s / speed_limit_m_s:.4f}",
            "insertionChecks": "none",
        },
    )


def netconvert(parts: Mapping[str, ET.Element]) -> str:
    """Return the text of the network file that netconvert builds from its inputs.

    ``parts`` are the root elements of the inputs, by kind ("node", "edge", "connection").

    Raises:
        ScenarioError: netconvert refuses the inputs.
        SimulationError: netconvert cannot be run.
    """
    with tempfile.TemporaryDirectory() as scratch:
        network, arguments = Path(scratch, "net.xml"), []
        for name, root in parts.items():
            file = Path(scratch, f"{name}.xml")
            file.write_text(xml_text(root), encoding="utf-8")
            arguments += [f"--{name}-files", str(file)]
        _run_netconvert(arguments, network)
        text = network.read_text(encoding="utf-8")
    return re.sub(r"<!-- generated on .*?-->\s*", "", text, count=1, flags=re.DOTALL)


def _run_netconvert(files: Sequence[str], network: Path) -> None:
    """Let netconvert write the file ``network``; ``files`` are the options that name its inputs."""
    executable = program("netconvert")
    arguments = [
        *files,
        *("--output-file", str(network)),
        *("--no-internal-links", "true", "--no-turnarounds", "true"),
        *("--offset.disable-normalization", "true", "--precision", str(PRECISION)),
    ]
    environment = os.environ | {"SUMO_HOME": str(executable.parents[1])}
    try:
        done = subprocess.run(
            [executable, *arguments], capture_output=True, text=True, check=False, env=environment
        )
    except OSError as error:
        raise SimulationError(f"SUMO's netconvert cannot be run: {error}.") from error
    if done.returncode == 127:
        raise SimulationError(missing_library("SUMO's netconvert", done.stderr))
    if done.returncode != 0 or not network.is_file():
        reason = " ".join(done.stderr.split()) or f"exit status {done.returncode}"
        raise ScenarioError(f"SUMO's netconvert cannot build this road: {reason}")
