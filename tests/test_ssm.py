"""Our time to collision and DRAC against SUMO's own surrogate safety measures (the SSM device).

What is compared: the finite time to collision with ``scene.seen.own_front`` at each decision, as
the check and the results take it, and the TTC that the device on the ego logs for the same foe in
an encounter of type 2 (following, the ego behind). Both are the net gap, bumper to bumper without
minGap, over the closing speed. The DRAC, in the column ``max_drac_m_s2`` of ``drl-av evaluate
--criticality``, is half of the closing speed squared over that gap; the device prints nine
decimals. The device works at the end of a SUMO step but stamps the time at which that began: its
3.5 s is our snapshot of 4.0 s, and of the start it knows nothing.

Where they cannot be compared: the device loses a leader that is on another edge than the ego (the
loop has four edges, joined by junctions without lanes inside), and finds it again as soon as the
ego is on that edge, too. So every decision with a leader on the ego's edge compares, and at every
other one the device has no following at all; both are asserted. The device drops encounters whose
TTC is never finite; where ours is infinite it logs none or NA.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.rule_based import IdmDriver, IdmSumoDriver, RandomDriver
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.evaluation.criticality import required_deceleration
from drl_av.road.snapshot import EGO
from drl_av.safety.paper import closing_speed, time_to_collision
from drl_av.scenarios.folder import ScenarioDescription, write_scenario

CONFIG = Config().updated("simulation", decisions_per_episode=60)
FOLLOWING = "2"
"""The device's number for an encounter in which the ego follows the foe."""


class Look(NamedTuple):
    """The vehicle ahead at one decision."""

    time_s: float
    foe: str
    ttc_s: float
    drac_m_s2: float
    same_edge: bool
    centered: bool
    """Both have their centres in one lane, which is all that the device knows of lanes."""


class Trip(NamedTuple):
    """An episode: the states of all vehicles, and who was ahead when."""

    states: list[tuple[list[float], ...]]
    looks: list[Look]


DRIVERS = {
    "idm": IdmDriver(CONFIG.safety),
    "idm-sumo": IdmSumoDriver(CONFIG.safety),
    "random": RandomDriver(),
}


def trip(
    driver: Driver, seed: int, vehicles: int, scenario: str, sumo_options: Sequence[str] = ()
) -> Trip:
    """Drive an episode and end SUMO, so that the device writes its file."""
    env = HighwayEnv(scenario=scenario, config=CONFIG, sumo_options=sumo_options)
    taken = Trip([], [])

    def look(scene: Scene) -> None:
        shot, front = scene.snapshot, scene.affordances.own_front
        states = (shot.s_m, shot.y_m, shot.speed_m_s, shot.lateral_speed_m_s)
        taken.states.append(tuple(state.tolist() for state in states))
        if front is None:
            return
        edges = [env.simulation._sumo.vehicle.getRoadID(shot.ids[row]) for row in (EGO, front[0])]
        look = Look(
            shot.time_s,
            shot.ids[front.vehicle],
            time_to_collision(front.gap_m, closing_speed(front)),
            required_deceleration(front.gap_m, closing_speed(front)),
            same_edge=edges[0] == edges[1],
            centered=env.road.lane_of(float(shot.y_m[front.vehicle])) == scene.affordances.lane,
        )
        taken.looks.append(look)

    for decision in rollout(env, driver, seed, vehicles):
        if not taken.states:
            look(decision.scene)
        look(decision.next_scene)
    env.close()
    return taken


def logged(file: Path) -> dict[tuple[float, str], tuple[float, float]]:
    """The device's TTC and DRAC of the ego as a follower, by our time and by the foe."""
    found = {}
    for conflict in ET.parse(file).getroot().iter("conflict"):
        spans = [conflict.find(name) for name in ("timeSpan", "typeSpan", "TTCSpan", "DRACSpan")]
        values = [span.attrib["values"].split() for span in spans if span is not None]
        for began, kind, ttc, drac in zip(*values, strict=True):
            if kind == FOLLOWING:
                time_s = float(began) + CONFIG.simulation.step_length_s
                found[time_s, conflict.attrib["foe"]] = (
                    math.inf if ttc == "NA" else float(ttc),
                    0.0 if drac == "NA" else float(drac),
                )
    return found


def with_device(file: Path) -> list[str]:
    """SUMO's options for the device on the ego."""
    options = {"explicit": "ego", "measures": "TTC DRAC", "thresholds": "1e9 0"}
    options |= {"trajectories": "true", "range": "250", "extratime": "0", "file": str(file)}
    own = [word for name, value in options.items() for word in (f"--device.ssm.{name}", value)]
    return [*own, "--precision", "9"]


@pytest.mark.parametrize(
    ("name", "seed", "vehicles", "circumference_m"),
    [
        *(("idm", 850_001, 30, 500.0), ("idm-sumo", 850_003, 30, 500.0)),
        ("random", 850_004, 25, 500.0),
        *(("idm", 850_005, 20, 2000.0), ("idm-sumo", 850_006, 30, 2000.0)),
    ],
)
def test_time_to_collision_and_drac_are_those_of_sumo_s_device_at_every_decision_that_it_sees(
    name: str, seed: int, vehicles: int, circumference_m: float, tmp_path: Path
) -> None:
    write_scenario(tmp_path / "loop", ScenarioDescription(circumference_m=circumference_m))
    arguments = (DRIVERS[name], seed, vehicles, str(tmp_path / "loop"))
    without = trip(*arguments)
    ours = trip(*arguments, with_device(tmp_path / "ssm.xml"))
    assert ours.states == without.states  # the device changes nothing
    theirs = logged(tmp_path / "ssm.xml")
    compared = 0
    for time_s, foe, ttc_s, drac_m_s2, same_edge, centered in ours.looks:
        found = theirs.get((time_s, foe))
        if time_s == 0.0 or not same_edge or not centered:
            assert found is None
        elif math.isinf(ttc_s):
            assert found is None or found == (math.inf, 0.0)
            assert drac_m_s2 == 0.0
        else:
            assert found == pytest.approx((ttc_s, drac_m_s2), rel=1e-6, abs=1e-9)
            compared += 1
    lost = sum(not look.same_edge and math.isfinite(look.ttc_s) for look in ours.looks)
    assert compared >= 5
    assert compared > lost
