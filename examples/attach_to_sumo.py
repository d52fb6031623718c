"""Let a driver and a safety check drive one vehicle of a SUMO simulation of your own.

python examples/attach_to_sumo.py          in plain SUMO, inside this process
python examples/attach_to_sumo.py --gui    in sumo-gui
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import drl_av
from drl_av.sumo_programs import program

NODES = """<nodes><node id="a" x="0" y="0"/><node id="b" x="1000" y="0"/>
<node id="c" x="1300" y="0"/><node id="d" x="2500" y="100"/><node id="e" x="2800" y="120"/>
<node id="f" x="4500" y="120"/><node id="r" x="700" y="-200"/><node id="x" x="3200" y="-60"/>
</nodes>"""
EDGES = """<edges><edge id="m1" from="a" to="b" numLanes="3" speed="33" priority="3"/>
<edge id="on" from="r" to="b" numLanes="1" speed="20" priority="3"/>
<edge id="m2" from="b" to="c" numLanes="4" speed="33" priority="3"/>
<edge id="m3" from="c" to="d" numLanes="3" speed="33" priority="3"/>
<edge id="m4" from="d" to="e" numLanes="4" speed="33" priority="3"/>
<edge id="m5" from="e" to="f" numLanes="3" speed="33" priority="3"/>
<edge id="off" from="e" to="x" numLanes="1" speed="20" priority="3"/></edges>"""
LANES = {
    ("on", "m2"): [(0, 0)],
    ("m1", "m2"): [(0, 1), (1, 2), (2, 3)],
    ("m2", "m3"): [(1, 0), (2, 1), (3, 2)],
    ("m3", "m4"): [(0, 1), (1, 2), (2, 3)],
    ("m4", "off"): [(0, 0)],
    ("m4", "m5"): [(1, 0), (2, 1), (3, 2)],
}
TYPE = 'carFollowModel="IDM" accel="1.5" decel="4" emergencyDecel="4" laneChangeModel="SL2015"'
TRAFFIC = f"""<routes><vType id="car" {TYPE} maxSpeedLat="0.76"/>
<vType id="truck" {TYPE} maxSpeedLat="0.76" vClass="truck" length="12" width="2.5" maxSpeed="24"/>
<flow id="through" type="car" from="m1" to="m5" end="600" vehsPerHour="3600" departLane="random"/>
<flow id="truck" type="truck" from="m1" to="m5" end="600" vehsPerHour="300" departLane="0"/>
<flow id="ramp" type="car" from="on" to="m5" end="600" vehsPerHour="500"/>
<vehicle id="veh7" type="car" depart="120" departLane="2" departSpeed="20">
<route edges="m1 m2 m3 m4 off"/></vehicle></routes>"""

PARTS = {"node": "nod", "edge": "edg", "connection": "con"}


def write(folder: Path) -> list[str]:
    """Write a motorway with two ramps, and return the options with which SUMO opens it."""
    links = "".join(
        f'<connection from="{one}" to="{other}" fromLane="{a}" toLane="{b}"/>'
        for (one, other), pairs in LANES.items()
        for a, b in pairs
    )
    files = {"nod": NODES, "edg": EDGES, "con": f"<connections>{links}</connections>"}
    for name, text in files.items():
        (folder / f"m.{name}.xml").write_text(text, encoding="utf-8")
    (folder / "m.rou.xml").write_text(TRAFFIC, encoding="utf-8")
    parts = [f"--{name}-files={folder}/m.{key}.xml" for name, key in PARTS.items()]
    built = [str(program("netconvert")), *parts, "-o", str(folder / "m.net.xml")]
    subprocess.run(built, check=True, capture_output=True)
    net, routes = str(folder / "m.net.xml"), str(folder / "m.rou.xml")
    options = "--step-length 0.5 --lateral-resolution 3.2 --collision.mingap-factor 0"
    return ["-n", net, "-r", routes, *options.split()]


with tempfile.TemporaryDirectory() as name:
    options = write(Path(name))
    if "--gui" in sys.argv:
        import traci as sumo

        sumo.start([str(program("sumo-gui")), "--start", "--quit-on-end", *options])
    else:
        import libsumo as sumo

        sumo.start(["sumo", *options])
    while "veh7" not in sumo.vehicle.getIDList():
        sumo.simulationStep()
    print(f"veh7 departs among {len(sumo.vehicle.getIDList()) - 1} vehicles")
    ego = drl_av.attach(sumo, "veh7", driver="gap-mobil", safety_check="strict")
    while "veh7" in sumo.vehicle.getIDList():
        decision = ego.step()
        if decision is not None and "change" in decision["words"]:
            print(f"{sumo.simulation.getTime():.0f} s: {decision['words']}")
        lane = sumo.vehicle.getLaneID("veh7")
        sumo.simulationStep()
    print(f"veh7 arrives by {lane}")
    sumo.close()
