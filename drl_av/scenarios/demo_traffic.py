"""The demo traffic of an open road, which SUMO alone drives: placed vehicles, or an inflow."""

import xml.etree.ElementTree as ET
from typing import Any

from drl_av.config import TrafficConfig
from drl_av.road.snapshot import EGO_ID
from drl_av.scenarios.layout import OpenPlan, route_on, split_long_edges
from drl_av.scenarios.netconvert import DEMO_END_S, vehicle_element

EGO_DEPARTS_S = 60
"""Time at which the ego enters if the other vehicles come as an inflow."""


def traffic(description: Any) -> ET.Element:
    """Return SUMO's route file: the vehicles that the scenario places, or an inflow and an ego.

    ``description`` is an ``OpenDescription``.
    """
    plan = split_long_edges(description.plan())
    root = ET.Element("routes")
    for name, edges in plan.routes.items():
        ET.SubElement(root, "route", id=name, edges=" ".join(edges))
    if description.vehicles:
        _place(root, description, plan)
    else:
        _let_enter(root, description, plan)
    return root


def _place(root: ET.Element, description: Any, plan: OpenPlan) -> None:
    """Add the vehicles that the scenario places exactly; no others enter."""
    for vehicle in description.vehicles:
        edge = next(
            edge
            for edge in reversed(plan.edges)
            if edge.begin_m <= vehicle.position_m and vehicle.lane in edge.lanes
        )
        is_way = vehicle.id == EGO_ID or plan.road.is_partial(vehicle.lane)
        name = route_on(plan.routes, edge.id, is_way)
        vehicle_element(
            root,
            vehicle,
            description.speed_limit_m_s,
            route=name,
            departEdge=str(plan.routes[name].index(edge.id)),
            departLane=str(vehicle.lane - edge.lanes[0]),
            departPos=f"{vehicle.position_m - edge.begin_m:.2f}",
        )


def _let_enter(root: ET.Element, description: Any, plan: OpenPlan) -> None:
    """Add an inflow in each lane, and the ego, which enters later."""
    traffic, limit_m_s = TrafficConfig(), description.speed_limit_m_s
    desired_m_s = (traffic.desired_speed_min_m_s + traffic.desired_speed_max_m_s) / 2
    first, *_, last = [*plan.routes, *plan.routes]
    lanes = {edge.id: edge.lanes for edge in plan.edges}
    entry, ego_entry = (lanes[plan.routes[name][0]] for name in (first, last))
    for lane in plan.start.lanes if description.flow_per_h else ():
        ET.SubElement(
            root,
            "flow",
            id=f"flow{lane}",
            type="traffic",
            route=first,
            begin="0",
            end=str(DEMO_END_S),
            vehsPerHour=repr(description.flow_per_h),
            departLane=str(lane - entry[0]),
            departSpeed="max",
            speedFactor=f"{min(desired_m_s / limit_m_s, 1.0):.4f}",
        )
    ET.SubElement(
        root,
        "vehicle",
        id="ego",
        type="ego",
        route=last,
        depart=str(EGO_DEPARTS_S),
        departLane=str((plan.start.ego_lane or ego_entry[0]) - ego_entry[0]),
        departSpeed=repr(min(plan.start.ego_speed_m_s or 20.0, description.speed_limit_m_s)),
    )
