"""A world whose agents another engine moves, such as CARLA; `World` gives spawns, hand-over and outcomes."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.cosim import Vehicle, Walker
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.carla.server import Controls, LiveServer
from vpsci_ros.lockstep.engines import Engine
from vpsci_ros.world import RUNNING, Scenario, World, WorldConfig, engine
from vpsci_ros.world.tables import Inputs

ABSENT = 500.0  # [m] from the vehicle: nobody is there (an exam's reference), and the server gets no walker


class EngineWorld(World):
    """A world whose episodes run one after the other in an engine's server.

    At each tick `World` computes the vehicle's controls and the velocity that the pedestrian wants. The server moves
    both; contact and arrival follow from the places that the server returns.

    :param server: moves the agents of an episode; the other parameters are those of `World`.
    :raises InvalidInput: more than one episode at once, several pedestrians, parked vehicles, a vehicle that is
        replayed; or, as an episode begins, a pedestrian that is replayed within `ABSENT`.
    """

    def __init__(
        self,
        server: LiveServer,
        config: WorldConfig,
        scenarios: Sequence[Scenario],
        episodes: Iterable[tuple[int, int]],
        batch: int,
        seed: int,
        **options: Any,
    ) -> None:
        drivers = config.vehicle_driver, config.pedestrian_driver
        parked = [scenario.name for scenario in scenarios if len(scenario.parked)]
        if batch * config.pedestrians > 1 or parked or config.vehicle_driver == "replay":
            raise InvalidInput(
                "engine = carla: expected batch = 1, pedestrians = 1, no parked vehicles, no vehicle that is replayed; "
                f"got {batch}, {config.pedestrians}, parked vehicles in {parked}, drivers {drivers}"
            )
        self._server = server
        super().__init__(config, scenarios, episodes, batch, seed, **options)

    def _start(self, slots: NDArray[np.int64], *rest: Any) -> NDArray[np.void]:
        started = super()._start(slots, *rest)
        if len(slots):
            record = self.state[0]
            names = ("x", "y", "heading", "speed")
            car = Vehicle(*(float(record[f"vehicle_{name}"]) for name in names))
            walker = Walker(*(float(record[f"pedestrian_{name}"]) for name in Walker._fields))
            absent = math.hypot(walker.x - car.x, walker.y - car.y) > ABSENT
            if self.config.pedestrian_driver == "replay" and not absent:
                raise InvalidInput("engine = carla: recorded people are not replayed in a server; leave them out")
            self._server.place(car, None if absent else walker)
        return started

    def _move(self, answers: Inputs, part: slice) -> None:
        before = self.state.copy()
        super()._move(answers, part)
        if before["status"][0] != RUNNING:
            return
        record, last = self.state[0], before[0]
        wanted = Walker(*(float(record[f"pedestrian_{name}"]) for name in Walker._fields))
        controls = Controls(*(float(record[name]) for name in Controls._fields))
        car, walker = self._server.tick(controls, wanted)
        for name in ("status", "outcome", "frame", "struck", "vehicle_goal", "pedestrian_goal", "least_curvttc"):
            record[name] = last[name]
        for name in ("route_s", "pedestrian_s", "vehicle_path", "pedestrian_path"):
            record[name] = last[name]
        record["vehicle_x"], record["vehicle_y"] = car.x, car.y
        turned = math.remainder(car.heading - float(last["vehicle_heading"]), 2.0 * math.pi)
        record["vehicle_heading"] = last["vehicle_heading"] + turned
        record["vehicle_speed"] = max(0.0, car.speed)  # it never reverses; CARLA's rolls back by a little as it stops
        if car.curvature is not None and car.speed > 0.0:
            record["vehicle_curvature"] = car.curvature
        record["vehicle_acceleration"] = (record["vehicle_speed"] - last["vehicle_speed"]) / self.config.tick
        for name, value in walker._asdict().items() if walker else ():
            record[f"pedestrian_{name}"] = value
        for agent in ("vehicle", "pedestrian"):
            gone = [record[f"{agent}_{axis}"] - last[f"{agent}_{axis}"] for axis in "xy"]
            record[f"{agent}_path"] += math.hypot(*gone)
        engine.arrive(self.state, self._before, self._tables, self._settings, self._bits)


CARLA = Engine(LiveServer, EngineWorld)
