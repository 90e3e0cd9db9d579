"""A bag of the rule-based pair, simulated without nodes."""

from pathlib import Path


def bag_of_the_rule_based_pair(bag: Path, episode_time: float) -> Path:
    """Write a bag of the episodes 1:0, 6:4 and 1:2, one after the other."""
    from vpsci_ros.bags.run_record import node_record
    from vpsci_ros.bags.simulated import write_ticks
    from vpsci_ros.parameters import values_of
    from vpsci_ros.world import World, WorldConfig, load_scenarios
    from vpsci_ros.world.loop import Loop

    drivers = {"vehicle_driver": "autopilot", "pedestrian_driver": "autopilot"}
    config = WorldConfig(spawn="paper", episode_time=episode_time, **drivers)
    queue = [(1, 0), (6, 4), (1, 2)]
    world = World(config, load_scenarios([1, 6]), queue, 1, 3)
    run = {"seed": 3, "scenarios": [1, 6], "batch": 1, "queue": queue}
    nodes = [node_record("world_simulator", values_of(config) | run), node_record("safety_monitor", {})]
    write_ticks(Loop(world), config, bag, {}, nodes)
    return bag
