"""The files of a scenario folder: network, vehicle types, demo traffic, view, checksums."""

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any

from drl_av.traffic.circular import BARRICADES_FILE
from drl_av.traffic.kinds import kind_of, stated_kind
from drl_av.traffic.network import DEMO_END_S, xml_text
from drl_av.traffic.own_types import own_types
from drl_av.traffic.vehicle_types import type_attributes

DESCRIPTION_FILE = "scenario.toml"
NETWORK_FILE = "highway.net.xml"
VEHICLE_TYPES_FILE = "vehicle_types.add.xml"
TRAFFIC_FILE = "traffic.rou.xml"
CONFIG_FILE = "highway.sumocfg"
VIEW_FILE = "view.xml"
CHECKSUMS_FILE = "SHA256SUMS"
ALL_FILES = (
    DESCRIPTION_FILE,
    NETWORK_FILE,
    VEHICLE_TYPES_FILE,
    BARRICADES_FILE,
    TRAFFIC_FILE,
    CONFIG_FILE,
    VIEW_FILE,
)
"""The files that have checksums; other files in the folder belong to the user."""


def scenario_texts(description: Any) -> dict[str, str]:
    """Return the text of each file of a scenario folder, by file name.

    Raises:
        ScenarioError: netconvert refuses the description.
        SimulationError: netconvert cannot be run.
    """
    kind = kind_of(description)
    texts = {
        DESCRIPTION_FILE: stated_kind(description) + description.to_toml(),
        NETWORK_FILE: kind.network_text(description),
        VEHICLE_TYPES_FILE: xml_text(_vehicle_types(description)),
        TRAFFIC_FILE: xml_text(kind.traffic(description)),
        CONFIG_FILE: xml_text(_configuration(description)),
        VIEW_FILE: xml_text(_view()),
    }
    texts |= {name: xml_text(root) for name, root in kind.additional(description).items()}
    return texts | {CHECKSUMS_FILE: checksums({n: t.encode() for n, t in texts.items()})}


def checksums(files: Mapping[str, bytes]) -> str:
    """Return the checksums of files in the format of ``sha256sum``, one line for each file."""
    return "".join(
        f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in sorted(files.items())
    )


def additional_files(description: Any) -> tuple[str, ...]:
    """Return the names of the files that SUMO loads before its vehicles, vehicle types first."""
    return (VEHICLE_TYPES_FILE, *kind_of(description).additional(description))


def _vehicle_types(description: Any) -> ET.Element:
    """Return SUMO's additional file with the vehicle types."""
    root = ET.Element("additional")
    size = description.vehicle_length_m, description.vehicle_width_m
    types = type_attributes(*size)
    for attributes in (*types, *(own.attributes(types[0]) for own in own_types(description))):
        ET.SubElement(root, "vType", attributes)
    return root


def _configuration(description: Any) -> ET.Element:
    """Return the SUMO configuration that opens the scenario with its demo traffic."""
    sections = {
        "input": {
            "net-file": NETWORK_FILE,
            "route-files": TRAFFIC_FILE,
            "additional-files": ",".join(additional_files(description)),
        },
        "time": {"begin": "0", "end": str(DEMO_END_S), "step-length": "0.5"},
        "processing": {
            "lateral-resolution": repr(description.lane_width_m),
            "time-to-teleport": "-1",
            "collision.action": "warn",
            "collision.mingap-factor": "0",
        },
        "report": {"xml-validation": "never"},
        "gui_only": {"gui-settings-file": VIEW_FILE, "delay": "100"},
    }
    root = ET.Element("configuration")
    for section, options in sections.items():
        parent = ET.SubElement(root, section)
        for option, value in options.items():
            ET.SubElement(parent, option, value=value)
    return root


def _view() -> ET.Element:
    """Return view settings of sumo-gui: real-world colours, and captions of points of interest.

    A caption is the parameter ``caption`` of its point. The view sets no viewport, which would undo
    the zoom of the simulation, and no delay, with which libsumo's close never returns.
    """
    root = ET.Element("viewsettings")
    scheme = ET.SubElement(root, "scheme", name="real world")
    ET.SubElement(scheme, "edges", showLinkRules="0")
    text = {"show": "1", "size": "60", "color": "white", "bgColor": "40,40,40", "constantSize": "1"}
    caption = {f"poiText_{name}": value for name, value in text.items()}
    ET.SubElement(scheme, "pois", {"poiTextParam": "caption"} | caption)
    return root
