"""Our pedestrian crosses in highway-env: its IDM car drives on a straight road and brakes for whom it sees in its lane.

    pip install -c constraints.txt '.[highway]'
    python examples/highway_crossing.py 3

highway-env's y points down, so y and heading change their sign. It simulates 15 times a second, which is neither our
tick nor a multiple of it. It has no pedestrians: ours is an obstacle of 0.6 m, for which its driver model (IDM) brakes
while it stands in the lane. The IDM knows no standstill, and would drive backwards before an obstacle nearer than its
gap; `Car` stops.
"""

import sys

import numpy as np
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.objects import Obstacle

from vpsci_ros import Pedestrian, Vehicle, Walker
from vpsci_ros.safety import clearance

PERIOD, SECONDS, SPEED = 1 / 15, 25.0, 5.0  # [s], [s], [m/s]


class Car(IDMVehicle):
    """highway-env's driver, whose car brakes to a standstill and no further."""

    def step(self, dt):
        """Advance by dt [s] with a braking that ends at 0 m/s."""
        self.action["acceleration"] = max(self.action["acceleration"], -self.speed / dt)
        super().step(dt)


class Person(Obstacle):
    """A pedestrian as highway-env has obstacles, which the cars on its lane follow."""

    LENGTH = WIDTH = 0.6


def play(episode):
    """Play one episode; return the car's x, y, heading, speed and the pedestrian's x, y, vx, vy, float64[T, 8].

    In our frame [m, rad, m/s]: the road runs along x, the lane's middle is y = 0.
    """
    network = RoadNetwork()
    network.add_lane("a", "b", StraightLane([-100.0, 0.0], [200.0, 0.0], width=3.5, speed_limit=SPEED))
    road = Road(network, np_random=np.random.default_rng(episode))
    driver = Car(road, [-22.0, 0.0], heading=0.0, speed=SPEED, target_speed=SPEED)
    person = Person(road, [0.0, 5.0])
    road.vehicles, road.objects = [driver], [person]
    pedestrian = Pedestrian(seed=1, episode=episode, route=[(0.0, -8.0), (0.0, 8.0)])
    me, rows = Walker(0.0, -5.0, 0.0, pedestrian.person.speed), []
    while len(rows) * PERIOD < SECONDS:
        (x, y), speed = driver.position, driver.speed
        car = Vehicle(x, -y, -driver.heading, speed, length=driver.LENGTH, width=driver.WIDTH)
        rows.append((*car[:4], *me))
        walk = pedestrian.step(me, {"car": car}, period=PERIOD)
        road.act()
        road.step(PERIOD)
        me = Walker(*walk[:4])
        person.position, person.speed, person.heading = np.array([me.x, -me.y]), 0.0, 0.0
    return np.array(rows)


if __name__ == "__main__":
    for episode in range(int(sys.argv[1]) if sys.argv[1:] else 3):
        rows = play(episode)
        near = clearance(*rows.T[:3], *rows.T[4:6], length=Car.LENGTH, width=Car.WIDTH).min()
        slow, over = rows[:, 3].min(), rows[:, 5] > 3.0
        across = f"across after {over.argmax() * PERIOD:.1f} s" if over.any() else "not across"
        print(f"episode {episode}: nearest {near:.1f} m, the car at {slow:.1f} m/s at least, {across}")
