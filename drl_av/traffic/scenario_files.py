"""The files of a scenario folder: vehicle types, barricades, demo traffic, view, checksums."""

import hashlib
import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping

from drl_av.traffic.description import PlacedVehicle, ScenarioDescription
from drl_av.traffic.network import EDGES, edge_lengths_m, network_text, point, xml_text
from drl_av.traffic.vehicle_types import type_attributes

DESCRIPTION_FILE = "scenario.toml"
NETWORK_FILE = "highway.net.xml"
VEHICLE_TYPES_FILE = "vehicle_types.add.xml"
BARRICADES_FILE = "barricades.add.xml"
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
"""The files that the checksums cover; other files in the folder belong to the user."""

DEMO_END_S = 3600
DEMO_VEHICLES = 16
DEMO_PITCH_M = 30.0
"""Smallest distance between demo vehicles on a lane."""
DEMO_SPEEDS_M_S = (30.0, 22.0, 26.0, 20.0, 32.0, 24.0, 28.0)
DEMO_START_SPEED_M_S = 15.0
BLOCK_M, BLOCK_PITCH_M, BLOCK_WIDTH_M = 3.0, 6.0, 0.8
PAVEMENT_COLOR = "70,70,70"
BLOCK_COLORS = ("190,190,190", "220,90,30")


def scenario_texts(description: ScenarioDescription) -> dict[str, str]:
    """The text of every file of a scenario folder, by file name.

    Raises:
        ScenarioError: netconvert refused the description.
        SimulationError: netconvert cannot be run.
    """
    texts = {
        DESCRIPTION_FILE: description.to_toml(),
        NETWORK_FILE: network_text(description),
        VEHICLE_TYPES_FILE: xml_text(_vehicle_types(description)),
        TRAFFIC_FILE: xml_text(_traffic(description)),
        CONFIG_FILE: xml_text(_configuration(description)),
        VIEW_FILE: xml_text(_view()),
    }
    if description.barricaded_lanes:
        texts[BARRICADES_FILE] = xml_text(_barricades(description))
    return texts | {CHECKSUMS_FILE: checksums({n: t.encode() for n, t in texts.items()})}


def checksums(files: Mapping[str, bytes]) -> str:
    """One line for each file, in the format of ``sha256sum``."""
    return "".join(
        f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in sorted(files.items())
    )


def additional_files(description: ScenarioDescription) -> tuple[str, ...]:
    """Names of the files that SUMO loads before its vehicles: types, and barricades if any."""
    barricades = (BARRICADES_FILE,) if description.barricaded_lanes else ()
    return (VEHICLE_TYPES_FILE, *barricades)


def _vehicle_types(description: ScenarioDescription) -> ET.Element:
    root = ET.Element("additional")
    size = description.vehicle_length_m, description.vehicle_width_m
    for attributes in type_attributes(*size):
        ET.SubElement(root, "vType", attributes)
    return root


def _barricades(description: ScenarioDescription) -> ET.Element:
    """Pavement and blocks in two colours; SUMO draws no pavement on closed lanes."""
    root = ET.Element("additional")
    circumference_m, width_m = description.circumference_m, description.lane_width_m
    blocks = math.floor(circumference_m / BLOCK_PITCH_M)
    block_turn = BLOCK_M / circumference_m
    for lane in description.barricaded_lanes:
        left_of_middle_m = (lane - (description.lanes - 1) / 2) * width_m
        radius_m = circumference_m / (2 * math.pi) - left_of_middle_m
        for k in range(blocks):
            start, name = k / blocks, f"{lane}_{k}"
            paved = _patch(radius_m, width_m, start, (k + 1) / blocks)
            block = _patch(radius_m, BLOCK_WIDTH_M, start, start + block_turn)
            _polygon(root, f"pavement_{name}", PAVEMENT_COLOR, "-1", paved)
            _polygon(root, f"barricade_{name}", BLOCK_COLORS[k % 2], "5", block)
    return root


def _patch(radius_m: float, width_m: float, start_turn: float, end_turn: float) -> str:
    inner_m, outer_m = radius_m - width_m / 2, radius_m + width_m / 2
    corners = ((inner_m, start_turn), (inner_m, end_turn), (outer_m, end_turn))
    return " ".join(point(*corner) for corner in (*corners, (outer_m, start_turn), corners[0]))


def _polygon(root: ET.Element, name: str, color: str, layer: str, shape: str) -> None:
    kind = name.split("_")[0]
    attributes = {"id": name, "type": kind, "color": color, "fill": "1", "layer": layer}
    ET.SubElement(root, "poly", attributes, shape=shape)


def demo_vehicles(description: ScenarioDescription) -> tuple[PlacedVehicle, ...]:
    """The placed vehicles of the scenario, or vehicles spread evenly over its open lanes."""
    if description.vehicles:
        return description.vehicles
    lanes = [lane for lane, is_open in enumerate(description.open_lanes) if is_open]
    rows = min(
        math.ceil(DEMO_VEHICLES / len(lanes)),
        math.floor(
            description.circumference_m / max(DEMO_PITCH_M, 6 * description.vehicle_length_m)
        ),
    )
    pitch_m = description.circumference_m / rows
    return tuple(
        PlacedVehicle(
            id=f"vehicle{i}" if i else "ego",
            lane=lanes[i % len(lanes)],
            position_m=round((i // len(lanes) + (i % len(lanes) + 0.5) / len(lanes)) * pitch_m, 2),
            speed_m_s=min(DEMO_START_SPEED_M_S, description.speed_limit_m_s),
            desired_speed_m_s=DEMO_SPEEDS_M_S[i % len(DEMO_SPEEDS_M_S)],
        )
        for i in range(min(DEMO_VEHICLES, rows * len(lanes)))
    )


def _traffic(description: ScenarioDescription) -> ET.Element:
    root = ET.Element("routes")
    laps = math.ceil(DEMO_END_S * description.speed_limit_m_s / description.circumference_m) + 1
    edges = " ".join(f"e{i}" for i in range(EDGES))
    ET.SubElement(root, "route", id="loop", edges=edges, repeat=str(laps))
    for vehicle in demo_vehicles(description):
        edge, position_m = _edge_and_position(description, vehicle.position_m)
        ET.SubElement(
            root,
            "vehicle",
            id=vehicle.id,
            type="ego" if vehicle.id == "ego" else "traffic",
            route="loop",
            depart="0",
            departEdge=str(edge),
            departLane=str(vehicle.lane),
            departPos=f"{position_m:.2f}",
            departSpeed=f"{vehicle.speed_m_s:.2f}",
            speedFactor=f"{vehicle.desired_speed_m_s / description.speed_limit_m_s:.4f}",
            insertionChecks="none",
        )
    return root


def _edge_and_position(description: ScenarioDescription, position_m: float) -> tuple[int, float]:
    lengths_m = edge_lengths_m(description.circumference_m)
    edge = min(int(position_m // lengths_m[0]), EDGES - 1)
    return edge, position_m - edge * lengths_m[0]


def _configuration(description: ScenarioDescription) -> ET.Element:
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
    """Real-world colours, and a caption on each vehicle from its parameter ``caption``.

    The view sets no viewport, which would undo the zoom of the simulation, and no delay, with which
    libsumo's close never returns.
    """
    root = ET.Element("viewsettings")
    scheme = ET.SubElement(root, "scheme", name="real world")
    ET.SubElement(scheme, "edges", showLinkRules="0")
    text = {"show": "1", "size": "60", "color": "white", "bgColor": "40,40,40", "constantSize": "1"}
    caption = {f"vehicleText_{name}": value for name, value in text.items()}
    ET.SubElement(scheme, "vehicles", {"vehicleTextParam": "caption"} | caption)
    return root
