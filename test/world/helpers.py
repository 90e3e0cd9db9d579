"""What the world's tests share: episodes run to their end, frame by frame, under a policy that is plain arithmetic."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world import IDLE, World, WorldConfig, load_scenarios, observe
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.tick import NO_ACTIONS, Actions, Assessment

AUTOPILOT = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot")
SCENARIOS = load_scenarios(range(1, 9))

Policy = Callable[[NDArray[np.void]], tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]]


def cautious(state: NDArray[np.void]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Actions float64[B, 2] that brake and swerve a little, row by row from the row's own observation."""
    vehicle, pedestrian = (o.astype(np.float64) for o in observe(state))
    along = np.stack([-0.6 * vehicle[:, 0], 0.05 * vehicle[:, 3]], axis=1)
    return along, np.stack([-0.3 * pedestrian[:, 0], -0.4 * pedestrian[:, 1]], axis=1)


def nothing(world: World) -> Actions:
    """Actions of zero acceleration."""
    return Actions(vehicle=np.zeros((len(world.state), 2)), pedestrian=np.zeros((len(world.state), 2)))


def calm(world: World) -> Assessment:
    """What a monitor says that sees no danger anywhere."""
    far = np.full(len(world.state), np.inf)
    return world.now.assessed(far, far, np.zeros(len(far), bool))


def alarm(world: World) -> Assessment:
    """What a monitor says that sees danger everywhere."""
    near = np.full(len(world.state), 3.0)
    return world.now.assessed(near, near, np.ones(len(near), bool))


def frames(world: World, policy: Policy = cautious) -> Iterable[tuple[NDArray[np.void], NDArray[np.void]]]:
    """Run a world to its end; yield a copy of the state of each tick and the events of the step after it."""
    loop = Loop(world)
    while not world.done:
        step = loop.step(Actions(*policy(world.state)) if world.now.policy_frame.any() else NO_ACTIONS)
        yield step.tick.state, step.events


def episodes(world: World, policy: Policy = cautious) -> dict[tuple[int, int], NDArray[np.void]]:
    """Run a world to its end; return the frames of each episode, EPISODE[T], by (scenario, number)."""
    rows = np.concatenate([state[state["status"] != IDLE] for state, _ in frames(world, policy)])
    keys, place = np.unique(rows[["scenario", "episode"]], return_inverse=True)
    order = np.argsort(place, kind="stable")  # an episode's frames stay one after the other
    parts = np.split(rows[order], np.cumsum(np.bincount(place))[:-1])
    return {(int(s), int(e)): part for (s, e), part in zip(keys, parts, strict=True)}


def run(
    pairs: Iterable[tuple[int, int]],
    batch: int = 16,
    config: WorldConfig = AUTOPILOT,
    policy: Policy = cautious,
    seed: int = 1,
) -> dict[tuple[int, int], NDArray[np.void]]:
    """Return the frames of some episodes of the package's own scenarios, see `episodes`."""
    return episodes(World(config, SCENARIOS, pairs, batch, seed), policy)
