"""Our pedestrian crosses in SUMO: SUMO drives the car; beside it SUMO's own pedestrian in the same episode.

    pip install -c constraints.txt '.[sumo]'
    python examples/sumo_crossing.py 4

SUMO's cars give way at the marked crosswalk. `benchmarks/sumo_pedestrians.py` compares many episodes.
"""

import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import sumo
import traci

from vpsci_ros import Driver, Pedestrian, Vehicle, Walker
from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH, clearance
from vpsci_ros.world import load_scenario

PERIOD, PATIENCE, ROAD = 0.05, 40.0, 3.5  # [s], [s], [m] width of the lane
QUIET = ["--no-step-log", "true", "-W", "--collision.action", "none"]
SCENARIO = load_scenario(1)
LANE, CROSSING = SCENARIO.vehicle.path, SCENARIO.pedestrian.path.at(SCENARIO.pedestrian.conflict)


def along(x, y):
    """Return where along the lane [m] its sample nearest to (x, y) is."""
    return float(np.hypot(*(LANE.points - (x, y)).T).argmin() * LANE.step)


def points(places):
    """Return places along the lane and left of it [m] as SUMO's files have them."""
    return " ".join("{:.2f},{:.2f}".format(*LANE.beside(s, left)) for s, left in places)


def network(folder):
    """Write the corner in SUMO's plain XML, have netconvert make a network of it and start SUMO; return its file."""
    last, net = along(*CROSSING), f"{folder}/corner.net.xml"
    border = [(s, ROAD / 2) for s in (*np.arange(0.0, last, 2.0), last)]  # left of the lane, from A to B
    square = [(last + s, left) for s, left in ((-3, -3.75), (-3, 3.75), (3, 3.75), (3, -3.75))]
    a, b, c = (LANE.beside(*place) for place in (border[0], border[-1], (last + 60.0, ROAD / 2)))
    road = f'numLanes="1" spreadType="right" width="{ROAD}" sidewalkWidth="2"'
    path = 'numLanes="1" spreadType="right" width="2" allow="pedestrian"'
    nodes = f'<node id="A" x="{a[0]}" y="{a[1]}"/><node id="C" x="{c[0]}" y="{c[1]}"/>'
    nodes += f'<node id="B" x="{b[0]}" y="{b[1]}" shape="{points(square)}"/>'
    edges = f'<edge id="in" from="A" to="B" {road} shape="{points(border)}"/><edge id="out" from="B" to="C" {road}/>'
    edges += f'<edge id="back" from="B" to="A" {path} shape="{points(border[::-1])}"/>'
    edges += f'<edge id="left" from="C" to="B" {path}/>'
    ways = f'<crossing node="B" edges="out" priority="1" width="4" shape="{points([(last, -2), (last, 2)])}"/>'
    ways += '<connection from="in" to="out" fromLane="1" toLane="1"/>'
    command = [f"{sumo.SUMO_HOME}/bin/netconvert", "--offset.disable-normalization", "-o", net]
    for kind, text in (("node", nodes), ("edge", edges), ("connection", ways)):
        (folder / f"{kind}.xml").write_text(f"<{kind}s>{text}</{kind}s>")
        command.append(f"--{kind}-files={folder / kind}.xml")
    subprocess.run(command, check=True, capture_output=True)
    traci.start([f"{sumo.SUMO_HOME}/bin/sumo", "-n", net, *QUIET], stdout=subprocess.DEVNULL)
    return net


def play(net, number, who):
    """Play an episode with "our" or "SUMO's" pedestrian, or "nobody"; return a row a step, float64[T, 8].

    A row has the car's x, y, heading, speed, and the pedestrian's x, y, vx, vy [m, rad, m/s].
    """
    driver, pedestrian = (kind(seed=1, episode=number, scenario=SCENARIO) for kind in (Driver, Pedestrian))
    (me, car, rows), most, pace = (pedestrian.start, driver.start, []), driver.person.speed, pedestrian.person.speed
    kerb, (near, far) = traci.lane.getShape("in_0")[-1], traci.lane.getShape(":B_c0_0")
    left = math.dist(me[:2], CROSSING) - math.dist(kerb, near) - math.dist(near, far) / 2  # as far to go as on our way
    place = max(0.0, traci.lane.getLength("in_0") - max(0.0, left))
    begins = f'departPos="{along(*car[:2]) + VEHICLE_LENGTH / 2}" departSpeed="{min(car.speed, most)}" departLane="1"'
    made = f'<vType id="car" length="{VEHICLE_LENGTH}" width="{VEHICLE_WIDTH}" maxSpeed="{most}"/>'
    made += f'<vehicle id="car" type="car" depart="0" {begins} insertionChecks="none"><route edges="in out"/></vehicle>'
    walks = f'<person id="he" depart="0" departPos="{place}"><walk edges="in back" speed="{pace}"/></person>'
    (routes := Path(net).with_name("episode.xml")).write_text(f"<routes>{made}{walks * (who != 'nobody')}</routes>")
    traci.load(["-n", net, "-r", str(routes), "--step-length", f"{PERIOD}", "--seed", f"{number}", *QUIET])
    while (traci.simulationStep() or "car" in traci.vehicle.getIDList()) and len(rows) * PERIOD < PATIENCE:
        (x, y), angle = traci.vehicle.getPosition("car"), math.radians(traci.vehicle.getAngle("car"))
        x, y = x - math.sin(angle) * VEHICLE_LENGTH / 2, y - math.cos(angle) * VEHICLE_LENGTH / 2  # was the bumper's
        car = Vehicle(x, y, math.pi / 2 - angle, traci.vehicle.getSpeed("car"))
        if who == "SUMO's" and "he" in traci.person.getIDList():
            angle, pace = math.radians(traci.person.getAngle("he")), traci.person.getSpeed("he")
            me = Walker(*traci.person.getPosition("he"), pace * math.sin(angle), pace * math.cos(angle))
        rows.append((*car[:4], *me))
        if who == "our":
            me = Walker(*pedestrian.step(me, {"car": car}, period=PERIOD)[:4])
            traci.person.moveToXY("he", "", me.x, me.y, math.degrees(math.atan2(me.vx, me.vy)), keepRoute=2)
    return np.array(rows)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        net = network(Path(folder))
        for who in ("our", "SUMO's"):
            rows = play(net, int(sys.argv[1]) if sys.argv[1:] else 4, who)
            near, slow = clearance(*rows.T[:3], *rows.T[4:6]).min(), rows[:, 3].min()
            print(f"{who} pedestrian: nearest {near:.1f} m, the car at {slow:.1f} m/s at least")
        traci.close()
