"""One agent for your own engine: the default pedestrian, or the default driver, without ROS and torch.

At each step your engine gives `Pedestrian` or `Driver` the states of all road users (`Vehicle`, `Walker`); it returns
its motion to the next step. The same seed, episode and inputs give the same bits as in our world, whose code both run.
docs/pedestrian.md has an example.
"""

from vpsci_ros.cosim.agent import Person
from vpsci_ros.cosim.driver import Drive, Driver
from vpsci_ros.cosim.inputs import Vehicle, Walker
from vpsci_ros.cosim.pedestrian import Pedestrian, Walk

__all__ = ["Drive", "Driver", "Pedestrian", "Person", "Vehicle", "Walk", "Walker"]
