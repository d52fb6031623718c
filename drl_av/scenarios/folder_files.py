"""The files of a scenario folder: network, vehicle types, demo traffic, view, checksums."""

import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

from drl_av.config import TrafficConfig
from drl_av.road.snapshot import EGO_ID
from drl_av.road.vehicle_types import VEHICLE, type_attributes
from drl_av.scenarios.custom_vehicle_types import CustomVehicleType
from drl_av.scenarios.loop import BARRICADES_FILE
from drl_av.scenarios.netconvert import DEMO_END_S, NETWORK_FILE, xml_text
from drl_av.scenarios.road_description import RoadDescription
from drl_av.scenarios.road_types import stated_road_type

DESCRIPTION_FILE = "scenario.toml"
VEHICLE_TYPES_FILE = "vehicle_types.add.xml"
TRAFFIC_FILE = "traffic.rou.xml"
CONFIG_FILE = "highway.sumocfg"
VIEW_FILE = "view.xml"
CHECKSUMS_FILE = "SHA256SUMS"
TOP_SPEED_M_S = float(VEHICLE["maxSpeed"])
_SUMO_ALONE = "for SUMO alone (sumo-gui -c highway.sumocfg); drl-av does not read this file."
COMMENTS = {
    NETWORK_FILE: "The road, for drl-av and for SUMO alone.",
    VEHICLE_TYPES_FILE: "The vehicle types, for drl-av and for SUMO alone.",
    BARRICADES_FILE: "A drawing of the closed lanes, which the network closes, for sumo-gui.",
    TRAFFIC_FILE: "Demo traffic " + _SUMO_ALONE,
    CONFIG_FILE: "The simulation " + _SUMO_ALONE,
    VIEW_FILE: "The appearance in sumo-gui, for drl-av and for SUMO alone.",
}
"""The comment at the beginning of each XML file: what it holds, and which program reads it."""
ALL_FILES = (DESCRIPTION_FILE, *COMMENTS)
"""The files that have checksums; other files in the folder belong to the user."""


SHOWN_M = (400.0, 250.0)
"""Width and height of what sumo-gui shows at first of a larger network."""


def scenario_texts(description: RoadDescription) -> dict[str, str]:
    """Return the text of each file of a scenario folder, by file name.

    Raises:
        ScenarioError: netconvert refuses the description.
        SimulationError: netconvert cannot be run.
    """
    stated = stated_road_type(description)
    network = description.network_text()
    texts = {
        DESCRIPTION_FILE: stated + description.to_toml(),
        NETWORK_FILE: network,
        VEHICLE_TYPES_FILE: xml_text(_vehicle_types(description)),
        TRAFFIC_FILE: xml_text(_demo(description.traffic(), description)),
        CONFIG_FILE: xml_text(_configuration(description)),
        VIEW_FILE: xml_text(_view(ET.fromstring(network))),
    }
    texts |= {name: xml_text(root) for name, root in description.additional().items()}
    texts = {name: _commented(text, COMMENTS.get(name, "")) for name, text in texts.items()}
    return texts | {CHECKSUMS_FILE: checksums({n: t.encode() for n, t in texts.items()})}


def _commented(text: str, comment: str) -> str:
    """Return an XML document with a comment after its first line."""
    declaration, _, rest = text.partition("\n")
    return f"{declaration}\n<!-- {comment} -->\n{rest}" if comment else text


def _demo(root: ET.Element, description: RoadDescription) -> ET.Element:
    """Return the demo traffic with the mean parameters of the environment's default traffic."""
    size = description.vehicle_length_m, description.vehicle_width_m
    traffic = TrafficConfig()
    fast = {"maxSpeed": repr(max(TOP_SPEED_M_S, description.speed_limit_m_s))}
    demo = fast | {
        "id": "demo",
        "tau": _mean(traffic.headway_min_s, traffic.headway_max_s),
        "accel": _mean(traffic.acceleration_min_m_s2, traffic.acceleration_max_m_s2),
        "lcSpeedGain": _mean(traffic.speed_gain_min, traffic.speed_gain_max),
    }
    others, ego = type_attributes(*size)
    types = [_demo_types(others | demo, description.vehicle_types)]
    names = {"traffic": types[0].attrib["id"]}
    if description.speed_limit_m_s > TOP_SPEED_M_S:
        names["ego"] = "demo.ego"
        types.append(ET.Element("vType", ego | fast | {"id": names["ego"]}))
    for element in root:
        if "type" in element.attrib:
            element.set("type", names.get(element.attrib["type"], element.attrib["type"]))
    if description.plan().road.speed_limits:  # a speedFactor would differ from limit to limit
        for placed, element in zip(description.vehicles, root.iter("vehicle"), strict=False):
            own = {"id": f"placed.{placed.id}", "maxSpeed": repr(placed.desired_speed_m_s)}
            types.append(ET.Element("vType", (ego if placed.id == EGO_ID else others | demo) | own))
            element.attrib |= {"type": own["id"], "speedFactor": "1"}
    for place, element in enumerate(types):
        root.insert(place, element)
    return root


def _demo_types(demo: dict[str, str], own: Sequence[CustomVehicleType]) -> ET.Element:
    """Return the type "demo" with these attributes, or a distribution of types by their shares."""
    if not own:
        return ET.Element("vType", demo)
    mix = ET.Element("vTypeDistribution", id="demo.mix")
    shares = {each.id: each.share for each in own}
    shares = {"traffic": max(1 - sum(shares.values()), 0.0)} | shares
    for attributes in (demo | {"id": "traffic"}, *(each.attributes(demo) for each in own)):
        name = attributes["id"]
        given = {"id": f"demo.{name}", "probability": f"{shares[name]:.6g}"}
        ET.SubElement(mix, "vType", attributes | given)
    return mix


def _mean(low: float, high: float) -> str:
    return f"{(low + high) / 2:g}"


def checksums(files: Mapping[str, bytes]) -> str:
    """Return the checksums of files in the format of ``sha256sum``, one line for each file."""
    return "".join(
        f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in sorted(files.items())
    )


def additional_files(description: RoadDescription) -> tuple[str, ...]:
    """Return the names of the files that SUMO loads before its vehicles, vehicle types first."""
    own = (Path(path).name for path in description.additional_files)
    return (VEHICLE_TYPES_FILE, *description.additional(), *own)


def _vehicle_types(description: RoadDescription) -> ET.Element:
    """Return SUMO's additional file with the vehicle types."""
    root = ET.Element("additional")
    types = type_attributes(description.vehicle_length_m, description.vehicle_width_m)
    for attributes in (*types, *(own.attributes(types[0]) for own in description.vehicle_types)):
        ET.SubElement(root, "vType", attributes)
    return root


def _configuration(description: RoadDescription) -> ET.Element:
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


def _view(network: ET.Element) -> ET.Element:
    """Return view settings of sumo-gui: real-world colours, and captions of points of interest.

    A caption is the parameter ``caption`` of its point. On a network of more than twice ``SHOWN_M``
    a vehicle would be a dot: the window then shows the middle of the first edge with most lanes,
    where ramps join or leave. The view sets no delay, with which libsumo's close never returns.
    """
    root = ET.Element("viewsettings")
    west, south, east, north = _numbers(network.find("location"), "convBoundary")
    larger = max((east - west) / SHOWN_M[0], (north - south) / SHOWN_M[1])
    if larger > 2:
        widest = max((edge for edge in network.iter("edge") if not edge.get("function")), key=len)
        shape = _numbers(widest.find("lane"), "shape")
        before, after = (len(shape) // 2 - 1) // 2 * 2, len(shape) // 4 * 2
        x, y = (shape[before] + shape[after]) / 2, (shape[before + 1] + shape[after + 1]) / 2
        ET.SubElement(root, "viewport", zoom=f"{100 * larger:.0f}", x=f"{x:.1f}", y=f"{y:.1f}")
    scheme = ET.SubElement(root, "scheme", name="real world")
    ET.SubElement(scheme, "edges", showLinkRules="0")
    text = {"show": "1", "size": "60", "color": "white", "bgColor": "40,40,40", "constantSize": "1"}
    caption = {f"poiText_{name}": value for name, value in text.items()}
    ET.SubElement(scheme, "pois", {"poiTextParam": "caption"} | caption)
    return root


def _numbers(element: ET.Element | None, attribute: str) -> list[float]:
    assert element is not None
    return [float(word) for word in re.split("[ ,]", element.attrib[attribute])]
