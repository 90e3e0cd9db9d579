"""One agent for anybody's engine: the learned pedestrian, and the learned driver, without ROS and torch.

`Pedestrian` and `Driver` are the agents of our own world, one at a time: at each step of the other engine they are fed
where everybody is, and return how they move on. Same seed, episode and inputs give the same bits as in our world, for
they run its code on one record. `Vehicle` and `Walker` are what they are fed; docs/pedestrian.md has an example.
"""

from vpsci_ros.cosim.agent import Person
from vpsci_ros.cosim.driver import Drive, Driver
from vpsci_ros.cosim.inputs import Vehicle, Walker
from vpsci_ros.cosim.pedestrian import Pedestrian, Walk

__all__ = ["Drive", "Driver", "Pedestrian", "Person", "Vehicle", "Walk", "Walker"]
