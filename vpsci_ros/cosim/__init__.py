"""One agent for your own simulation engine: the default pedestrian or the default driver, without ROS and torch.

At each step your engine passes the states of all road users (`Vehicle`, `Walker`) to `Pedestrian` or `Driver`, which
returns its motion to the next step. With the same seed, episode and inputs the motion is that of our world, to the bit.
docs/pedestrian.md has an example.

In reading order:

* `pedestrian`: the default pedestrian as one object for your own simulation engine
* `driver`: the default driver as one object for your own simulation engine
* `agent`: what both share: a world of one episode
* `inputs`: the inputs of one step: checked states of all road users, completed from the previous step
* `way_round`: the way on foot round vehicles that stand: the shortest way past their corners
* `routes`: the scenario of a `Pedestrian` or `Driver` that is made from a route in your map
"""

from vpsci_ros.cosim.agent import Person
from vpsci_ros.cosim.driver import Drive, Driver
from vpsci_ros.cosim.inputs import Vehicle, Walker
from vpsci_ros.cosim.pedestrian import Pedestrian, Walk

__all__ = ["Drive", "Driver", "Pedestrian", "Person", "Vehicle", "Walk", "Walker"]
