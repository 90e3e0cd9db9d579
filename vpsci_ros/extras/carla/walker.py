"""The default pedestrian as a `carla.Walker` in a user's synchronous world."""

from collections.abc import Iterable
from typing import Any

from numpy.typing import ArrayLike

from vpsci_ros.cosim import Pedestrian
from vpsci_ros.cosim.pedestrian import Walk
from vpsci_ros.extras.carla.actors import vehicle_of, walker_control, walker_of


class LearnedWalker:
    """Moves a `carla.Walker` by a `vpsci_ros.Pedestrian`: call `step` before each `world.tick()`.

    :param actor: the walker, spawned where it is to set off; nobody else, no AI controller either, moves it.
    :param pedestrian: who it is; its route or goal is in this package's frame, y is CARLA's with the sign changed.
    """

    def __init__(self, actor: Any, pedestrian: Pedestrian) -> None:
        self.actor, self.pedestrian = actor, pedestrian

    def step(
        self,
        vehicles: Iterable[Any],
        walkers: Iterable[Any] = (),
        parked: ArrayLike | None = None,
        period: float = 0.05,
    ) -> Walk:
        """Apply the pedestrian's next velocity to the walker and return its motion, whose `faces` is an actor's id.

        :param vehicles: those that it may react to; `walkers`: the others; its own actor among them is left out.
        :param parked: see `Pedestrian.step`.
        :param period: `fixed_delta_seconds` of the world [s].
        :raises InvalidInput: see `Pedestrian.step`.
        """
        cars: Any = {each.id: vehicle_of(each) for each in vehicles}
        others: Any = {each.id: walker_of(each) for each in walkers if each.id != self.actor.id}
        walk = self.pedestrian.step(walker_of(self.actor), cars, others, parked, period)
        self.actor.apply_control(walker_control(walk.vx, walk.vy))
        return walk
