"""Other simulators at a comparable job, for bench_world.py: a line of JSON, {what: million agent-steps a second}.

    python benchmarks/peers.py vmas|libsumo|highway-env [--seconds 1.0]

Each does less than the world that it is compared with: none computes CurvTTC, hands over or starts fresh episodes.
"""

import argparse
import json
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

WINDOWS = 7

LENGTH = 900_000  # [m] of road: neither agent arrives
NET = f"""<net version="1.9"><edge id="road" from="a" to="b" priority="1">
<lane id="road_0" index="0" allow="pedestrian" speed="5" length="{LENGTH}" shape="0,0 {LENGTH},0"/>
<lane id="road_1" index="1" disallow="pedestrian" speed="14" length="{LENGTH}" shape="0,3 {LENGTH},3"/></edge>
<junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,5"/>
<junction id="b" type="dead_end" x="{LENGTH}" y="0" incLanes="road_0 road_1" intLanes=""
shape="{LENGTH},0 {LENGTH},5"/></net>"""
ROUTES = f"""<routes><vType id="car" vClass="passenger"/><route id="ahead" edges="road"/>
<vehicle id="car" type="car" route="ahead" depart="0"/><person id="walker" depart="0">
<walk from="road" to="road" departPos="0" arrivalPos="{LENGTH - 1000}" speed="1.5"/></person></routes>"""


def best(step: Callable[[], object], seconds: float, agent_steps: float) -> float:
    """Return million agent-steps a second in the best of `WINDOWS` windows; a step is `agent_steps` of them."""
    step()
    found = []
    for _ in range(WINDOWS):
        calls, begin = 0, time.perf_counter()
        while (spent := time.perf_counter() - begin) < seconds / WINDOWS or calls < 3:
            step()
            calls += 1
        found.append(calls / spent)
    return max(found) * agent_steps / 1e6


def vmas(seconds: float) -> dict[str, float]:
    """A car (kinematic bicycle, box) and a walker (disc) that push each other away, in vectorised worlds."""
    import torch
    from vmas.simulator.core import Agent, Box, Sphere, World
    from vmas.simulator.dynamics.kinematic_bicycle import KinematicBicycle

    found = {}
    for batch in (64, 1024, 8192, 65536):
        world = World(batch, "cpu", dt=0.05, substeps=1)
        bicycle = KinematicBicycle(world, width=1.85, l_f=1.44, l_r=1.44, max_steering_angle=0.52, integration="euler")
        car = Agent("car", shape=Box(4.69, 1.85), dynamics=bicycle, collide=True)
        walker = Agent("walker", shape=Sphere(0.3), collide=True)
        world.add_agent(car)
        world.add_agent(walker)
        action = torch.zeros(batch, 2)
        for agent in world.agents:
            agent.action.u = action

        def step(world: World = world, bicycle: KinematicBicycle = bicycle, walker: Agent = walker) -> None:
            bicycle.process_action()
            walker.dynamics.process_action()
            world.step()

        with torch.no_grad():
            found[f"world.step, {batch} worlds"] = best(step, seconds, 2 * batch)
    return found


def libsumo(seconds: float) -> dict[str, float]:
    """One car and one person on its pavement: crossing, which SUMO can do, is left out and not paid for."""
    import libsumo as sumo

    with tempfile.TemporaryDirectory() as folder:
        net, routes = Path(folder) / "net.xml", Path(folder) / "routes.xml"
        net.write_text(NET, encoding="utf-8")
        routes.write_text(ROUTES, encoding="utf-8")
        command = ["sumo", "-n", str(net), "-r", str(routes), "--step-length", "0.05", "--no-step-log", "--no-warnings"]

        def stepping(read: bool) -> Callable[[], None]:
            sumo.start(command)
            sumo.simulationStep()

            def step() -> None:
                for _ in range(100):
                    sumo.simulationStep()
                    if read:
                        sumo.vehicle.getPosition("car")
                        sumo.vehicle.getSpeed("car")
                        sumo.person.getPosition("walker")
                        sumo.person.getSpeed("walker")

            return step

        found = {}
        for read, name in ((True, "read back"), (False, "not read back")):
            found[name] = best(stepping(read), seconds, 200)
            sumo.close()
        return found


def highway_env(seconds: float) -> dict[str, float]:
    """Its intersection, through `env.step`; every vehicle and every simulated frame counts."""
    import gymnasium
    import highway_env as package

    gymnasium.register_envs(package)
    env = gymnasium.make("intersection-v2")
    env.reset(seed=0)
    frames = env.unwrapped.config["simulation_frequency"] / env.unwrapped.config["policy_frequency"]
    count = 0.0
    begin = time.perf_counter()
    while (spent := time.perf_counter() - begin) < seconds:
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        count += frames * len(env.unwrapped.road.vehicles)
        if terminated or truncated:
            env.reset()
    return {"env.step, frames of all vehicles": count / spent / 1e6}


PEERS: dict[str, Callable[[float], dict[str, float]]] = {
    "vmas": vmas,
    "libsumo": libsumo,
    "highway-env": highway_env,
}


def main() -> None:
    """Measure one peer and print a line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("peer", choices=PEERS)
    parser.add_argument("--seconds", type=float, default=1.0)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    try:
        found = PEERS[options.peer](options.seconds)
    except ImportError as error:
        sys.exit(f"not installed ({error.name})")
    print(json.dumps(found))


if __name__ == "__main__":
    main()
