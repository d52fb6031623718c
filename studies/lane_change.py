"""Draws a lane change and an aborted one, with both lateral plants, without SUMO."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from drl_av.config import Config, EgoConfig, SimulationConfig
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.affordances import compute_indicators
from drl_av.driving.maneuver import ROAD_CURVATURE_PER_M, curvature_command, next_lane_change, plan
from drl_av.driving.scene import LaneChange, Scene
from drl_av.evaluation.figure_style import label_axes, panels
from drl_av.road.road import FloatArray, Road
from drl_av.road.snapshot import Command, Snapshot
from drl_av.scenarios.folder import ScenarioDescription

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FINE = SimulationConfig(step_length_s=0.05)
"""Simulation steps that are short enough for a smooth curve."""
POINT_MASS, SLOWER, FASTER = ("#90a4ae", "-"), ("#1976d2", "-"), ("#c2185b", "--")
SETTLING_S = 2
"""The figure continues for this time, seconds, after the nominal end of the lane change."""


class Track(NamedTuple):
    """The ego's lateral motion over T steps; all arrays have shape (T + 1,)."""

    time_s: FloatArray
    """Time since the start, when the ego is at the centre of the right lane."""
    y_m: FloatArray
    lateral_speed_m_s: FloatArray
    curvature_per_m: FloatArray
    """Curvature that the steering law commands in this state, left positive."""


def track(ego: EgoConfig, speed_m_s: float, laterals: Sequence[Lateral]) -> Track:
    """Compute the ego's motion if it executes the lateral actions at a constant speed.

    ``laterals`` holds one action for each decision; ``driving.maneuver.plan`` executes it.
    """
    loop = ScenarioDescription()
    road = Road(loop.circumference_m, loop.lane_width_m, (True,) * loop.lanes)
    at, running = Command(speed_m_s, road.center_m(0), 0.0), None
    rows = [(at.y_m, 0.0, 0.0)]
    for lateral in laterals:
        scene = _scene(at, running, road)
        begun = next_lane_change(running, scene.affordances.lane, lateral)
        target_m = at.y_m if begun is None else road.center_m(begun.target)
        rows[-1] = (at.y_m, at.lateral_speed_m_s, _command(at, target_m, road, ego))
        commands, running = plan(scene, Action(lateral, Longitudinal.MAINTAIN), ego, FINE)
        for at in commands:
            rows.append((at.y_m, at.lateral_speed_m_s, _command(at, target_m, road, ego)))
    y_m, lateral_speed, curvature = np.array(rows, dtype=np.float64).T
    time_s = np.arange(len(rows), dtype=np.float64) * np.float64(FINE.step_length_s)
    return Track(time_s, y_m, lateral_speed, curvature)


def _scene(at: Command, running: LaneChange | None, road: Road) -> Scene:
    loop = ScenarioDescription()
    alone = Snapshot(
        time_s=0.0,
        ids=("ego",),
        s_m=np.zeros(1),
        y_m=np.array([at.y_m]),
        speed_m_s=np.array([at.speed_m_s]),
        lateral_speed_m_s=np.array([at.lateral_speed_m_s]),
        length_m=np.array([loop.vehicle_length_m]),
        width_m=np.array([loop.vehicle_width_m]),
    )
    return Scene(alone, compute_indicators(alone, road, road.lap_m), running, road)


def _command(at: Command, target_m: float, road: Road, ego: EgoConfig) -> float:
    heading = math.atan2(at.lateral_speed_m_s, at.speed_m_s)
    width_m = road.lane_width_m
    return curvature_command(
        ROAD_CURVATURE_PER_M, target_m - at.y_m, heading, at.speed_m_s, width_m, ego
    )


def lane_change_figure(config: Config) -> "Figure":
    """Draw lateral position, lateral speed and curvature command of a lane change and an abort.

    The curves show the plant ``kinematic``, and the plant ``steering`` at half and full speed.
    """
    duration_s = round(config.ego.lane_change_duration_s)
    half_s = max(duration_s // 2, 1)
    go, back = [Lateral.LEFT], [Lateral.RIGHT]
    stories = {
        "lane change": go + [Lateral.KEEP] * (duration_s + SETTLING_S - 1),
        f"abort after {half_s} s": go
        + [Lateral.KEEP] * (half_s - 1)
        + back
        + [Lateral.KEEP] * (duration_s + SETTLING_S - half_s - 1),
    }
    figure, axes_of = panels((9, 6.6), 3, 2, sharex=True, sharey="row")
    for column, (title, laterals) in zip(axes_of.T, stories.items(), strict=True):
        column[0].set_title(title, fontsize=11)
        _story(column, laterals, config.ego)
    for axes, name in zip(
        axes_of[:, 0],
        ("lateral position, m", "lateral speed, m/s", "curvature command, 1/km"),
        strict=True,
    ):
        axes.set_ylabel(name)
    figure.align_ylabels()
    handles, labels = axes_of[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    return figure


def _story(column: "Sequence[Axes]", laterals: Sequence[Lateral], ego: EgoConfig) -> None:
    position, drift, curvature = column
    width_m = ScenarioDescription().lane_width_m
    for center_m in (0.0, width_m):
        position.axhline(center_m, color="#cfd8dc", linewidth=1, zorder=0)
    position.axhline(width_m / 2, color="#cfd8dc", linewidth=1, linestyle=(0, (6, 6)), zorder=0)
    plants = {
        "kinematic, at any speed": (POINT_MASS, "kinematic", ego.max_speed_m_s),
        f"steering, {ego.max_speed_m_s / 2:g} m/s": (SLOWER, "steering", ego.max_speed_m_s / 2),
        f"steering, {ego.max_speed_m_s:g} m/s": (FASTER, "steering", ego.max_speed_m_s),
    }
    for label, ((color, line), plant, speed) in plants.items():
        there = track(replace(ego, lateral_plant=plant), speed, laterals)
        position.plot(there.time_s, there.y_m, line, color=color, label=label)
        drift.plot(there.time_s, there.lateral_speed_m_s, line, color=color)
        if plant == "steering":
            curvature.plot(there.time_s, 1000 * there.curvature_per_m, line, color=color)
    decided = {s: lateral for s, lateral in enumerate(laterals) if lateral is not Lateral.KEEP}
    for second, lateral in decided.items():
        position.text(second + 0.1, width_m, f"change {lateral.name.lower()}", va="top", size=9)
    for axes in column:
        label_axes(axes)
        for second in decided:
            axes.axvline(second, color="#37474f", linewidth=0.8, linestyle=":")
    curvature.set_xlabel("time, s")
