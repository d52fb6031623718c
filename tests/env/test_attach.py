"""A driver and a check for one vehicle of the user's own SUMO, in a network that is not ours."""

import re
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import libsumo as sumo
import numpy as np
import pytest
from nets import converted

import drl_av
from drl_av.config import Config
from drl_av.drivers.learned import INPUTS, MaskedPolicyDriver
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene
from drl_av.driving.wide_observation import WIDE_NAMES
from drl_av.env.attach import AttachedEgo
from drl_av.errors import ConfigError, SimulationError
from drl_av.safety.check import Rule, Verdict, permit_all

NODES = """<node id="a" x="0" y="0"/><node id="b" x="600" y="0"/>
<node id="c" x="1200" y="0"/><node id="x" x="1200" y="-200"/>"""
EDGES = """<edge id="in" from="a" to="b" numLanes="3" speed="40" width="3.5"/>
<edge id="on" from="b" to="c" numLanes="2" speed="25" width="3.5"/>
<edge id="off" from="b" to="x" numLanes="1" speed="40" width="3.5"/>"""
WAYS = "in 0 off 0", "in 1 on 0", "in 2 on 1"
CAR = (
    '<vType id="car" carFollowModel="IDM" laneChangeModel="SL2015" accel="1.5" decel="4" '
    'emergencyDecel="4" maxSpeedLat="0.76" length="5" width="1.8" maxSpeed="30" speedDev="0"/>'
)
USUAL = "--step-length 0.5 --lateral-resolution 3.5 --collision.mingap-factor 0"


@pytest.fixture(scope="module")
def net(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three lanes; the right one leads to "off", the two others to "on"."""
    return build(tmp_path_factory.mktemp("net"), EDGES)


def build(folder: Path, edges: str, nodes: str = NODES, ways: Sequence[str] = WAYS) -> Path:
    return converted(folder, nodes, edges, ways)


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    """Closes SUMO after each test."""
    yield
    sumo.close()


def begin(net: Path, vehicles: str, types: str = CAR, *options: str) -> None:
    """Start SUMO with these vehicles, and make the step in which they depart."""
    known = [edge for edge in ("on", "off") if f'<edge id="{edge}"' in net.read_text()]
    routes = "".join(f'<route id="{edge}" edges="in {edge}"/>' for edge in known) + types + vehicles
    file = net.parent / "demand.rou.xml"
    file.write_text(f"<routes>{routes}</routes>")
    wanted = options or USUAL.split()
    always = ("--no-warnings", "--insertion-checks", "none")
    sumo.start(["sumo", "-n", str(net), "-r", str(file), *always, *wanted])
    sumo.simulationStep()


def car(name: str, lane: int, at_m: float, speed: float = 20, route: str = "on") -> str:
    return (
        f'<vehicle id="{name}" type="car" route="{route}" depart="0" departLane="{lane}" '
        f'departPos="{at_m}" departSpeed="{speed}"/>'
    )


MAINTAIN, ACCELERATE, MAINTAIN_RIGHT, MAINTAIN_LEFT = 0, 1, 4, 8


class Does:
    """Proposes one action all the time, by default to keep lane and speed."""

    def __init__(self, number: int = MAINTAIN) -> None:
        self._action = ACTIONS[number]

    def start(self, seed: int) -> None:
        return None

    def act(self, scene: Scene, observation: object) -> Action:
        return self._action


class Looks(Does):
    def act(self, scene: Scene) -> Action:  # type: ignore[override]
        return self._action


Decision = dict[str, Any]


def attached(
    driver: Any = None, check: Any = "paper", **given: Any
) -> tuple[AttachedEgo, Scene, Decision]:
    """The ego under a driver, by default ``Does()``, and what it saw and decided at once."""
    ego = drl_av.attach(sumo, "ego", driver or Does(), check, **given)
    decision = ego.step()
    assert decision is not None
    return ego, ego.scene, decision


def drive(ego: AttachedEgo, seconds: float) -> None:
    """Drive on for this time, in steps of half a second."""
    for _ in range(round(2 * seconds)):
        ego.step()
        sumo.simulationStep()


def test_the_gap_ahead_reaches_over_the_junction(net: Path) -> None:
    # ego's front at 500 m of "in"; the other's rear at 100 - 5 m of "on", beyond the junction
    on = '<route id="next" edges="on"/>' + car("far", 1, 100, 20, "next")
    begin(net, car("ego", 2, 500) + on + car("decoy", 0, 520, 20, "off"))
    _, scene, decision = attached(Does(), "permit_all")
    in_m, over_m = sumo.lane.getLength("in_2"), sumo.lane.getLength(":b_1_1")
    front = scene.affordances.own_front
    assert front.gap_m == pytest.approx((in_m - 500) + over_m + (100 - 5), abs=1e-6)
    assert decision["indicators"][0] == front.gap_m
    # the decoy drives two lanes to the right: it is in no lane that the ego observes
    assert scene.affordances.right_front is None


def test_a_lane_that_leads_elsewhere_ends_and_must_be_left(net: Path) -> None:
    begin(net, car("ego", 0, 300))
    ego, scene, _ = attached("gap-mobil", "strict")
    within_m = pytest.approx(sumo.lane.getLength("in_0") - 300, abs=1e-6)
    assert scene.affordances.mandatory == (1, within_m)
    while "ego" in sumo.vehicle.getIDList() and sumo.vehicle.getRoadID("ego") != "on":
        sumo.simulationStep()
        ego.step()
    assert sumo.vehicle.getRoadID("ego") == "on"


@pytest.mark.parametrize("steps", [0, 2])
def test_a_step_that_is_not_called_after_each_step_of_sumo_is_refused(
    net: Path, steps: int
) -> None:
    begin(net, car("ego", 1, 100))
    ego, _, _ = attached()
    for _ in range(steps):
        sumo.simulationStep()
    with pytest.raises(SimulationError, match="call step once after each simulationStep"):
        ego.step()


def test_an_ego_that_sumo_teleports_is_an_error(net: Path) -> None:
    jam = CAR.replace('"car"', '"jam"').replace('maxSpeed="30"', 'maxSpeed="0.01"')
    there = car("ego", 2, 100, 0) + car("jam", 2, 130, 0).replace('"car"', '"jam"')
    begin(net, there, CAR + jam, *USUAL.split(), "--time-to-teleport", "4")
    ego = drl_av.attach(sumo, "ego", Does(), "paper")
    with pytest.raises(SimulationError, match="the vehicle 'ego', which has collided or waited"):
        drive(ego, 30)


def test_a_lane_change_takes_five_seconds_and_ends_on_the_centre(net: Path) -> None:
    slow = 'maxSpeed="20" actionStepLength="1" minGap="1" lcMaxSpeedLatStanding="0.1"'
    slow += ' lcMaxSpeedLatFactor="0"'
    begin(net, car("ego", 1, 100), CAR.replace('maxSpeed="30"', slow))
    sumo.simulationStep()  # now its model would act after the next step only
    ego = drl_av.attach(sumo, "ego", Does(MAINTAIN_LEFT), "paper")
    places = []
    for _ in range(10):  # 5 s in steps of 0.5 s: 0.35 m each
        drive(ego, 0.5)
        aside_m = sumo.vehicle.getLateralLanePosition("ego")
        places.append(3.5 * sumo.vehicle.getLaneIndex("ego") + aside_m)
    assert places == pytest.approx([3.5 + 0.35 * step for step in range(1, 11)], abs=1e-6)
    assert sumo.vehicle.getSpeed("ego") == pytest.approx(20.0)
    assert sumo.vehicle.getMinGap("ego") == 2.5  # others cut in no closer than ``strict`` assumes


def test_it_says_what_it_does_and_why_once_a_second(net: Path) -> None:
    begin(net, car("ego", 2, 100, 25) + car("slow", 2, 125, 5))
    ego, _, first = attached()  # 20 m ahead and 20 m/s slower: T_C is 1 s
    assert first["rule"] == "in_lane"
    assert first["words"] == "hard brake, keep lane instead of maintain, keep lane (in_lane)"
    assert (first["proposed_action"], first["executed_action"]) == (0, 3)
    sumo.simulationStep()
    assert ego.step() is None
    assert sumo.vehicle.getSpeed("ego") == pytest.approx(25 - 4 * 0.5)
    sumo.simulationStep()
    assert ego.step() is not None


@pytest.mark.parametrize(("hold_s", "proposes"), [(0.0, ACCELERATE), (20.0, MAINTAIN)])
def test_a_driver_of_the_user_holds_its_speed_too(net: Path, hold_s: float, proposes: int) -> None:
    begin(net, car("ego", 2, 100, 20) + car("slow", 2, 165, 19))
    _, _, decision = attached(Does(ACCELERATE), config={"driver": {"hold_s": hold_s}})
    assert decision["proposed_action"] == proposes


def test_it_enters_an_edge_within_its_limit_and_goes_when_the_vehicle_arrives(net: Path) -> None:
    begin(net, car("ego", 2, 460, 30))
    ego = drl_av.attach(sumo, "ego", Does(), "permit_all")
    speeds, fastest_on = [], 0.0
    while "ego" in sumo.vehicle.getIDList():
        ego.step()
        speeds.append(sumo.vehicle.getSpeed("ego"))
        if sumo.vehicle.getRoadID("ego") == "on":  # its limit is 25 m/s
            fastest_on = max(fastest_on, speeds[-1])
        sumo.simulationStep()
    assert 24.0 < fastest_on <= 25.0 + 1e-6
    assert 0.9 < max(a - b for a, b in pairwise(speeds)) <= 1.0 + 1e-6  # 2 m/s^2 for 0.5 s
    assert ego.step() is None


def test_a_lane_that_is_closed_to_the_vehicle_s_class_does_not_exist(tmp_path: Path) -> None:
    lanes = '<lane index="0" allow="bus" width="3.5"/></edge>'
    edges = EDGES.replace('speed="25" width="3.5"/>', f'speed="25" width="3.5">{lanes}')
    begin(build(tmp_path, edges), '<route id="next" edges="on"/>' + car("ego", 1, 50, 20, "next"))
    assert not attached()[1].affordances.right_lane


def test_a_truck_that_leaves_the_route_is_ahead_until_its_rear_has_left_the_lane(net: Path) -> None:
    long = '<vType id="long" length="18" maxSpeed="5" speedFactor="1"/>'
    long += '<route id="away" edges="off"/>'
    truck = car("truck", 0, 5, 5, "away").replace('type="car"', 'type="long"')
    begin(net, car("ego", 0, 550, 10) + truck, CAR + long)
    at_m, over_m = sumo.vehicle.getLanePosition("truck"), sumo.lane.getLength(":b_0_0")
    ahead_m = sumo.lane.getLength("in_0") - sumo.vehicle.getLanePosition("ego")
    ego, scene, _ = attached(Does(), "permit_all")
    front = scene.affordances.own_front
    assert front is not None  # though its lane is no part of the route
    assert front.gap_m == pytest.approx(ahead_m + over_m + at_m - 18, abs=1e-6)
    while sumo.vehicle.getLanePosition("truck") + over_m < 18 or ego._commands:
        sumo.simulationStep()
        ego.step()
    sumo.simulationStep()
    ego.step()
    assert ego.scene.snapshot.ids == ("ego",)


def test_on_a_ring_each_vehicle_is_where_it_is_nearest(tmp_path: Path) -> None:
    """Four edges of 100 m: e3 is behind the ego and, within its range of 250 m, ahead."""
    places = ((0, 0), (100, 0), (100, 100), (0, 100))
    nodes = "".join(f'<node id="n{k}" x="{x}" y="{y}"/>' for k, (x, y) in enumerate(places))
    edges = "".join(
        f'<edge id="e{k}" from="n{k}" to="n{(k + 1) % 4}" numLanes="1" speed="30"/>'
        for k in range(4)
    )
    net = build(tmp_path, edges, nodes, [f"e{k} 0 e{(k + 1) % 4} 0" for k in range(4)])
    ways = {k: " ".join(f"e{(k + n) % 4}" for n in range(40)) for k in (0, 1, 3)}
    routes = "".join(f'<route id="from{k}" edges="{way}"/>' for k, way in ways.items())
    cars = (("ego", 40, 0), ("ahead", 60, 1), ("behind", 50, 3))
    slow = CAR.replace('maxSpeed="30"', 'maxSpeed="5"')
    begin(net, "".join(car(name, 0, at, 5, f"from{k}") for name, at, k in cars), routes + slow)
    ego = drl_av.attach(sumo, "ego", Does(), "permit_all")
    told = 0
    for _ in range(160):  # a lap
        if ego.step() is not None:
            seen = ego.scene.affordances
            assert seen.own_front and seen.own_rear  # noqa: PT018
            if leader := sumo.vehicle.getLeader("ego", 300):
                told += 1
                gap_m = leader[1] + sumo.vehicle.getMinGap("ego")
                assert seen.own_front.gap_m == pytest.approx(gap_m, abs=1e-6)
        sumo.simulationStep()
    assert told > 40


def test_on_a_ring_a_vehicle_on_the_ego_s_own_edge_is_ahead_and_behind(tmp_path: Path) -> None:
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="300" y="0"/>'
    form = '<edge id="{}" from="{}" to="{}" numLanes="1" speed="30" length="{}" shape="{}"/>'
    there = form.format("long", "a", "b", 300, "0,0 300,0")
    back = form.format("short", "b", "a", 60, "300,0 150,90 0,0")
    net = build(tmp_path, there + back, nodes, ["long 0 short 0", "short 0 long 0"])
    laps = f'<route id="laps" edges="{"long short " * 9}"/>'
    begin(net, car("ego", 0, 10, 0, "laps") + car("other", 0, 200, 0, "laps"), laps + CAR)
    scene = attached(Does(), "permit_all")[1]
    assert scene.snapshot.ids == ("ego", "other", "other, 1")
    seen = scene.affordances
    inside_m = sum(sumo.lane.getLength(n) for n in sumo.lane.getIDList() if n[0] == ":")
    at_m = {name: sumo.vehicle.getLanePosition(name) for name in ("ego", "other")}
    behind_m = 300 - at_m["other"] + 60 + inside_m + at_m["ego"] - 5
    assert seen.own_rear.gap_m == pytest.approx(behind_m, abs=0.5)
    assert seen.own_front.gap_m == pytest.approx(at_m["other"] - 5 - at_m["ego"], abs=1e-6)


def test_of_two_lanes_that_lead_to_one_the_one_that_gives_way_ends(tmp_path: Path) -> None:
    edges = """<edge id="in" from="a" to="b" numLanes="2" speed="30" width="3.5"/>
    <edge id="on" from="b" to="c" numLanes="1" speed="30" width="3.5"/>"""
    begin(build(tmp_path, edges, ways=["in 0 on 0", "in 1 on 0"]), car("ego", 0, 400))
    _, scene, _ = attached("gap-mobil")
    major = {lane: sumo.lane.getLinks(f"in_{lane}")[0][5] == "M" for lane in (0, 1)}
    assert major == {0: False, 1: True}
    within_m = pytest.approx(sumo.lane.getLength("in_0") - 400, abs=1e-6)
    assert scene.affordances.mandatory == (1, within_m)


def a_road(
    folder: Path, lanes: list[int], ways: list[str], more: str = "", metres: int = 400
) -> Path:
    """Edges e0, e1, ... with these numbers of lanes; a way is from, lane, to, lane."""
    count = range(len(lanes) + 1)
    nodes = "".join(f'<node id="n{k}" x="{metres * k}" y="0"/>' for k in count)
    nodes += f'<node id="x" x="{metres}" y="-200"/><node id="y" x="{metres}" y="-400"/>'
    form = '<edge id="e{}" from="n{}" to="n{}" numLanes="{}" speed="30" width="3.5"/>'
    edges = "".join(form.format(k, k, k + 1, number) for k, number in enumerate(lanes))
    return build(folder, edges + more, nodes, ways)


def begin_on(net: Path, edges: str, vehicles: str, types: str = CAR) -> None:
    begin(net, vehicles, f'<route id="way" edges="{edges}"/>{types}')


def test_the_first_end_of_a_lane_counts(tmp_path: Path) -> None:
    """Lane 0 of e0 leads nowhere; another one, with the same number, ends 800 m later."""
    ways = ["e0 1 e1 0", "e0 2 e1 1", "e1 0 e2 1", "e1 1 e2 2", "e2 1 e3 0", "e2 2 e3 1"]
    net = a_road(tmp_path, [3, 2, 3, 2], ways, metres=200)
    begin_on(net, "e0 e1 e2 e3", car("ego", 0, 50, 20, "way"))
    mandatory = attached("gap-mobil")[1].affordances.mandatory
    assert mandatory.within_m == pytest.approx(sumo.lane.getLength("e0_0") - 50, abs=1e-6)


def test_the_end_of_a_lane_is_seen_in_time_over_short_edges(tmp_path: Path) -> None:
    ways = [f"e{k} {lane} e{k + 1} {lane}" for k in range(7) for lane in (0, 1)] + ["e7 1 e8 0"]
    net = a_road(tmp_path, [2] * 8 + [1], ways, metres=100)
    begin_on(net, " ".join(f"e{k}" for k in range(9)), car("ego", 0, 50, 20, "way"))
    assert attached("gap-mobil")[1].affordances.mandatory == (1, pytest.approx(750, abs=20))


def test_a_lane_that_splits_goes_on_in_the_lane_that_leads_on(tmp_path: Path) -> None:
    off = '<edge id="out" from="n2" to="y" numLanes="1" speed="30" width="3.5"/>'
    ways = ["e0 0 e1 0", "e0 0 e1 1", "e0 1 e1 2", "e1 0 out 0", "e1 1 e2 0", "e1 2 e2 1"]
    net = a_road(tmp_path, [2, 3, 2], ways, off)
    queue = '<route id="aside" edges="e1 out"/>' + car("queue", 0, 50, 0, "aside")
    begin_on(net, "e0 e1 e2", car("ego", 0, 300, 20, "way") + queue)
    _, scene, _ = attached()
    assert scene.affordances.own_front is None  # the queue is in the lane to the right
    assert scene.affordances.mandatory.lanes == 0
    assert "queue" in scene.snapshot.ids


def test_a_lane_that_splits_goes_on_in_the_lane_that_sumo_drives(tmp_path: Path) -> None:
    """Lane 0 of e1 is one more edge in which the lane to the exit begins: SUMO takes lane 1."""
    off = '<edge id="out" from="n3" to="y" numLanes="1" speed="30" width="3.5"/>'
    ways = ["e0 0 e1 0", "e0 0 e1 1", "e0 1 e1 2", *(f"e1 {k} e2 {k}" for k in range(3))]
    ways += ["e2 0 out 0", "e2 1 e3 0", "e2 2 e3 1"]
    net = a_road(tmp_path, [2, 3, 3, 2], ways, off)
    stands = '<route id="there" edges="e1 e2 e3"/>' + car("stands", 1, 50, 0, "there")
    begin_on(net, "e0 e1 e2 e3", car("ego", 0, 300, 20, "way") + stands)
    _, scene, _ = attached()
    gap_m = sumo.lane.getLength("e0_0") - 300 + 50 - 5
    assert gap_m < scene.affordances.own_front.gap_m < gap_m + 10  # the lane in the junction
    assert scene.affordances.mandatory.lanes == 0


def test_a_vehicle_on_the_way_in_is_seen_though_it_gives_way(tmp_path: Path) -> None:
    on = '<edge id="ramp" from="y" to="n1" numLanes="1" speed="20" width="3.5" priority="-1"/>'
    net = a_road(tmp_path, [1, 1], ["e0 0 e1 0", "ramp 0 e1 0"], on)
    enters = '<route id="aside" edges="ramp e1"/>' + car("enters", 0, 200, 6, "aside")
    begin_on(net, "e0 e1", car("ego", 0, 5, 0, "way") + enters)
    sumo.vehicle.moveTo("ego", "e0_0", sumo.lane.getLength("e0_0") - 150)
    sumo.vehicle.moveTo("enters", "ramp_0", sumo.lane.getLength("ramp_0") - 1)
    while not sumo.vehicle.getLaneID("enters").startswith(":"):
        sumo.vehicle.setSpeed("ego", 0.0)
        sumo.simulationStep()
    left_m = sumo.lane.getLength("e0_0") - sumo.vehicle.getLanePosition("ego")
    assert left_m - 5 < attached()[1].affordances.own_front.gap_m < left_m + 20


def test_a_vehicle_inside_a_junction_in_which_a_lane_splits_is_in_sight(tmp_path: Path) -> None:
    net = a_road(tmp_path, [1, 4], [f"e0 0 e1 {lane}" for lane in range(4)])
    other = car("other", 0, 350, 5, "way").replace("/>", ' arrivalLane="3"/>')
    begin_on(net, "e0 e1", car("ego", 0, 300, 5, "way") + other)
    insides = {sumo.lane.getLinks("e0_0")[lane][4]: lane for lane in range(4)}
    while (lane := sumo.vehicle.getLaneID("other")) not in insides:
        sumo.vehicle.setSpeed("ego", 0.0)
        sumo.simulationStep()
    assert insides[lane] == 3
    while sumo.vehicle.getLanePosition("other") < 6.0:  # its rear has left the ego's lane
        sumo.simulationStep()
    assert sumo.vehicle.getLaneID("other") == lane
    assert "other" in attached()[1].snapshot.ids


def test_the_exit_counts_behind_another_lane_of_its_number_that_ends(tmp_path: Path) -> None:
    """Lane 0 of e1 ends; that of e3, which has its number, leads to the exit."""
    off = '<edge id="out" from="n4" to="y" numLanes="1" speed="30" width="3.5"/>'
    ways = ["e0 0 e1 1", "e0 1 e1 2", "e1 1 e2 0", "e1 2 e2 1", "e2 0 e3 1", "e2 1 e3 2"]
    net = a_road(tmp_path, [2, 3, 2, 3, 2], [*ways, "e3 0 out 0"], off, metres=150)
    begin_on(net, "e0 e1 e2 e3 out", car("ego", 1, 100, 20, "way"))
    _, scene, _ = attached()
    assert scene.affordances.mandatory == (-2, pytest.approx(3 * 150 + 50, abs=25))


def test_the_way_that_lies_behind_the_ego_does_not_count(tmp_path: Path) -> None:
    on = '<edge id="ramp" from="y" to="n1" numLanes="1" speed="30" width="3" priority="-1"/>'
    net = a_road(tmp_path, [1, 1], ["e0 0 e1 0", "ramp 0 e1 0"], on)
    came = '<route id="came" edges="ramp e1"/>' + car("ego", 0, 10, 20, "came")
    begin_on(net, "e0 e1", came)
    sumo.vehicle.moveTo("ego", "e1_0", 100.0)
    sumo.simulationStep()
    attached(Does(), "strict")  # the ramp is narrower, and gives way


def test_a_closed_lane_between_open_ones_does_not_exist_before_it_begins(tmp_path: Path) -> None:
    net = a_road(tmp_path, [2, 4], ["e0 0 e1 2", "e0 1 e1 3"])
    begin_on(net, "e0 e1", car("ego", 0, 300, 20, "way"))
    sumo.lane.setDisallowed("e1_1", ["all"])
    _, scene, decision = attached(Does(MAINTAIN_RIGHT))
    assert not scene.affordances.right_lane
    assert decision["rule"] == "off_road"


def test_behind_a_lane_that_splits_a_vehicle_counts_in_both_lanes(tmp_path: Path) -> None:
    net = a_road(tmp_path, [2, 3], ["e0 0 e1 0", "e0 0 e1 1", "e0 1 e1 2"])
    behind = '<route id="all" edges="e0 e1"/>' + car("behind", 0, 350, 29, "all")
    begin_on(net, "e1", behind + car("ego", 1, 20, 8, "way"))
    _, scene, decision = attached(Does(MAINTAIN_RIGHT), "strict")
    assert scene.affordances.right_rear.gap_m == scene.affordances.own_rear.gap_m
    assert decision["rule"] == "lane_change"


def test_a_truck_that_leaves_over_a_short_edge_stays_in_sight(tmp_path: Path) -> None:
    off = '<edge id="out" from="n1" to="x" numLanes="1" speed="30" width="3.5" length="4"/>'
    off += '<edge id="out2" from="x" to="y" numLanes="1" speed="30" width="3.5"/>'
    off += '<edge id="back" from="y" to="n0" numLanes="1" speed="30" width="3.5" length="9"/>'
    ways = ["e0 0 e1 0", "e0 0 out 0", "out 0 out2 0", "out2 0 back 0", "back 0 e0 0"]  # a ring
    net = a_road(tmp_path, [1, 1], ways, off)
    long = '<vType id="long" length="18"/><route id="aside" edges="out2"/>'
    truck = car("truck", 0, 2, 0, "aside").replace('type="car"', 'type="long"')
    begin_on(net, "e0 e1", car("ego", 0, 300, 20, "way") + truck, CAR + long)
    front = attached(Does(), "permit_all")[1].affordances.own_front
    inside_m = [sumo.lane.getLength(name) for name in sumo.lane.getIDList() if name[0] == ":"]
    rear_m = sumo.lane.getLength("e0_0") + 4 + sumo.vehicle.getLanePosition("truck") - 18
    gap_m = rear_m - sumo.vehicle.getLanePosition("ego")
    assert gap_m < front.gap_m <= gap_m + sum(inside_m)


def test_a_slow_lane_does_not_limit_the_next_one(tmp_path: Path) -> None:
    lane = '<lane index="0" speed="15" width="3.5"/></edge>'
    usual, slower = 'numLanes="3" speed="40" width="3.5"/>', 'numLanes="3" speed="28" width="3.5">'
    edges = EDGES.replace(usual, slower + lane)
    begin(build(tmp_path, edges), car("ego", 0, 100, 10, "off"))
    limits = attached()[1].road.speed_limits
    here = [next(each.limit_m_s for each in own if each.begin_m == 2.0**19) for own in limits]
    assert here == pytest.approx([15.0, 28.0, 28.0])


def test_while_it_parks_the_ego_does_nothing(net: Path) -> None:
    begin(net, car("ego", 1, 100, 10))
    ego = drl_av.attach(sumo, "ego", Does(), "paper")
    sumo.vehicle.setStop("ego", "in", 140.0, 1, 5.0, 1)
    parked = 0
    for _ in range(40):
        ego.step()
        parked += sumo.vehicle.getLaneID("ego") == ""
        sumo.simulationStep()
    assert parked > 0
    assert sumo.vehicle.getLaneID("ego") != ""


def test_a_vehicle_of_the_user_without_sumo_s_checks_keeps_its_type(net: Path) -> None:
    begin(net, car("ego", 1, 100) + car("other", 2, 150))
    for name in ("ego", "other"):
        sumo.vehicle.setSpeedMode(name, 32)
    attached("gap-mobil", "strict")


def test_a_new_route_and_a_lane_that_is_closed_now_count_at_the_next_decision(net: Path) -> None:
    begin(net, car("ego", 1, 100))
    ego, scene, _ = attached()
    assert scene.affordances.mandatory.lanes == 0
    sumo.vehicle.changeTarget("ego", "off")  # from the lane on the right
    sumo.lane.setDisallowed("in_2", ["all"])
    for _ in range(2):
        sumo.simulationStep()
        ego.step()
    assert ego.scene.affordances.mandatory.lanes == -1
    assert not ego.scene.affordances.left_lane


def test_a_route_to_a_light_is_refused_under_strict_when_it_begins(tmp_path: Path) -> None:
    nodes = NODES.replace('id="c" x="1200" y="0"', 'id="c" x="1200" y="0" type="traffic_light"')
    nodes += '<node id="y" x="1800" y="0"/>'
    far = '<edge id="far" from="c" to="y" numLanes="2" speed="25" width="3.5"/>'
    begin(build(tmp_path, EDGES + far, nodes), car("ego", 1, 100))
    ego, *_ = attached(Does(), "strict")
    sumo.vehicle.changeTarget("ego", "far")
    sumo.simulationStep()
    ego.step()
    sumo.simulationStep()
    with pytest.raises(ConfigError, match=r"on_\d does: take the check paper"):
        ego.step()


@pytest.mark.parametrize(("lane", "side"), [(1, 1), (0, -1), (2, 1)])
def test_an_ego_off_its_centre_goes_there_first(net: Path, lane: int, side: int) -> None:
    begin(net, car("ego", lane, 100))
    sumo.vehicle.changeSublane("ego", 0.6 * side)
    while abs(sumo.vehicle.getLateralLanePosition("ego")) < 0.5:
        sumo.simulationStep()
    drive(drl_av.attach(sumo, "ego", Does(), "paper"), 5.0)
    assert sumo.vehicle.getLateralLanePosition("ego") == pytest.approx(0.0, abs=1e-6)
    assert sumo.vehicle.getLaneID("ego") == f"in_{lane}"


def test_a_line_that_no_vehicle_may_cross_is_not_crossed(tmp_path: Path) -> None:
    lane = '<lane index="1" changeLeft="authority" width="3.5"/></edge>'
    edges = EDGES.replace(
        'speed="40" width="3.5"/>\n<edge id="on"', f'speed="40" width="3.5">{lane}\n<edge id="on"'
    )
    begin(build(tmp_path, edges), car("ego", 1, 100))
    _, _, decision = attached(Does(MAINTAIN_LEFT))
    assert decision["executed_action"] == MAINTAIN
    assert decision["rule"] != ""


def test_the_ego_is_no_faster_than_its_vehicle(net: Path) -> None:
    begin(net, car("ego", 2, 100, 20), CAR.replace('maxSpeed="30"', 'maxSpeed="24"'))
    drive(drl_av.attach(sumo, "ego", "idm", "paper"), 10.0)
    assert sumo.vehicle.getSpeed("ego") == pytest.approx(24.0)


def test_strict_sees_as_far_as_it_must_whatever_the_driver_observes(tmp_path: Path) -> None:
    net = a_road(tmp_path, [1] * 4, [f"e{k} 0 e{k + 1} 0" for k in range(3)], metres=150)
    far = '<route id="end" edges="e3"/>' + car("far", 0, 50, 0, "end")
    begin_on(net, "e0 e1 e2 e3", car("ego", 0, 50, 20, "way") + far)
    for check, ids in (("paper", ("ego",)), ("strict", ("ego", "far"))):  # 450 m ahead
        short = {"observation": {"range_m": 10.0}}
        assert attached(Does(), check, config=short)[1].snapshot.ids == ids


def test_two_egos_drive_under_strict(net: Path) -> None:
    """The type of an ego that is attached has our limits, not those with which SUMO obeys us."""
    begin(net, car("one", 1, 100) + car("two", 2, 150))
    egos = [drl_av.attach(sumo, name, "gap-mobil", "strict") for name in ("one", "two", "one")]
    assert all(ego.step() is not None for ego in egos)


def test_a_driver_of_ppo_sees_the_road_of_the_simulation(net: Path) -> None:
    begin(net, car("ego", 2, 100, route="off"))  # two lanes to the left of its exit
    weight, bias = np.zeros((12, INPUTS), np.float32), np.zeros(12, np.float32)
    weight[MAINTAIN_RIGHT, WIDE_NAMES.index("ego_way_changes")] = -1.0
    bias[MAINTAIN] = 0.1
    trained_on_a_loop = MaskedPolicyDriver([(weight, bias)], permit_all, Config())
    _, _, decision = attached(trained_on_a_loop, None)
    assert decision["proposed_action"] == MAINTAIN_RIGHT


def check_without_a_rule(scene: Scene, proposed: Action) -> Verdict:
    return Verdict(ACTIONS[2], Rule.IN_LANE)


def test_the_user_s_own_check_decides(net: Path) -> None:
    begin(net, car("ego", 2, 100, 20))
    assert attached(Does(), check_without_a_rule)[2]["executed_action"] == 2


@pytest.mark.parametrize(
    ("options", "given", "sentence"),
    [
        ("--step-length 0.5", {}, "start it with --lateral-resolution"),
        (
            "--step-length 0.3 --lateral-resolution 3.5",
            *({}, "SUMO's step length is 0.3 s, but must divide one second"),
        ),
        (USUAL + " --step-method.ballistic=1", {}, "a longer way to stop .*: start it without"),
        (USUAL[:-2] + " -1", {}, "teleport the ego where it stops .*--collision.mingap-factor 0"),
        ("", {"vehicle": "nobody"}, "There is no vehicle 'nobody' on the road"),
        (
            *("", {"config": {"ego": {"max_speed_m_s": 19.0}}}),
            r"drives 20 m/s, but ego.max_speed_m_s is 19: raise that, .*: 21\}\}",
        ),
        ("", {"driver": "idm-sumo"}, "attach gap-mobil, idm-mobil or a learned driver"),
        ("", {"driver": "sumo"}, "leave lane changes to SUMO, which no longer drives"),
        (
            *("", {"driver": drl_av.load_driver("sumo"), "config": {"driver": {"hold_s": 2.0}}}),
            "leave lane changes to SUMO, which no longer drives",
        ),
        ("", {"driver": 3}, r"driver is a int, but must be an object with start\(seed\)"),
        ("", {"driver": Does}, "driver is a type, .*: a class or a function has to be called"),
        ("", {"driver": Looks()}, r"act of the driver 'Looks' is called with \(scene, observ"),
        ("", {"safety_check": 5}, "safety_check is 5, but must be a function of"),
        (
            *(USUAL.replace("3.5", "0.8"), {"safety_check": "strict"}),
            r"SUMO's option --lateral-resolution must be at least the lane width, 3.5",
        ),
        ("", {"connection": "sumo"}, "connection is 'sumo', but must be the module libsumo"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(
    net: Path, options: str, given: dict[str, Any], sentence: str
) -> None:
    begin(net, car("ego", 2, 100), CAR, *options.split())
    usual = {"connection": sumo, "vehicle": "ego", "driver": "gap-mobil"}
    with pytest.raises((ConfigError, SimulationError), match=sentence) as error:
        drl_av.attach(**(usual | given))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "key"),
    [
        ("emergencyDecel", 'emergencyDecel="9"'),
        ("speedDev", 'tau="0.4"'),
        ("speedDev", 'actionStepLength="1"'),
    ],
)
def test_a_type_that_brakes_harder_or_later_is_refused_under_strict(
    net: Path, old: str, key: str
) -> None:
    begin(net, car("ego", 2, 100), re.sub(rf' {old}="\d"', f" {key}", CAR))
    with pytest.raises(ConfigError, match=r"of the vehicle type car.* take .*paper") as error:
        attached("gap-mobil", "strict")
    assert key.partition("=")[0] in str(error.value)
    assert "\n" not in str(error.value)


def loads_a_type() -> None:
    sumo.vehicletype.copy("car", "hard")
    sumo.vehicletype.setEmergencyDecel("hard", 9.0)


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        (loads_a_type, "hard"),
        (lambda: sumo.vehicle.add("usual", "on"), "DEFAULT_VEHTYPE"),
        (lambda: sumo.vehicle.setEmergencyDecel("other", 9.0), "car@other"),
        (lambda: (sumo.vehicle.remove("other"), loads_a_type()), "hard"),
    ],
)
def test_a_type_that_is_new_later_must_keep_to_the_bounds_of_strict_too(
    changes: Callable[[], object], kind: str, net: Path
) -> None:
    begin(net, car("ego", 2, 100) + car("other", 1, 100))
    ego, *_ = attached("gap-mobil", "strict")
    sumo.vehicletype.copy("car", "soft")
    sumo.vehicle.setTau("other", 1.2)  # SUMO makes a type for it alone
    sumo.simulationStep()
    drive(ego, 2.0)
    changes()
    for _ in range(2):  # it does not drive on
        with pytest.raises(ConfigError, match=f"of the vehicle type {kind} must be at most"):
            drive(ego, 2.0)
        sumo.simulationStep()


def test_the_default_type_is_refused_under_strict_if_a_vehicle_has_it(net: Path) -> None:
    begin(net, car("ego", 1, 100) + '<vehicle id="usual" route="on" depart="0" departPos="300"/>')
    with pytest.raises(ConfigError, match="DEFAULT_VEHTYPE must be at most strict"):
        attached(Does(), "strict")


def test_strict_is_refused_where_the_route_has_a_light_and_paper_drives(tmp_path: Path) -> None:
    lit = NODES.replace('id="b" x="600" y="0"', 'id="b" x="600" y="0" type="traffic_light"')
    begin(build(tmp_path, EDGES, lit), car("ego", 2, 100))
    with pytest.raises(ConfigError, match=r"in_\d does: take the check paper"):
        attached("gap-mobil", "strict")
    attached("gap-mobil", "paper")


def test_lanes_of_different_widths_are_refused(tmp_path: Path) -> None:
    narrow = EDGES.replace('speed="25" width="3.5"', 'speed="25" width="3"')
    begin(build(tmp_path, narrow), car("ego", 2, 100))
    with pytest.raises(SimulationError, match=r"'on_0' on the route of 'ego' is 3 m wide"):
        attached("gap-mobil")
