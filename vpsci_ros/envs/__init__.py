"""Doors for people who train and test driving systems: Gymnasium environments and a PettingZoo one.

`gymnasium.make("vpsci_ros/RightTurn-v0")` after `import vpsci_ros.envs`: the environment's user drives the vehicle
through one of the scenarios, and the learned pedestrian (or a reference one) answers. `gymnasium.make_vec` gives the
batched form, `parallel.parallel_env` both agents. All are thin: the world, the monitor and the policy
are the ones that the nodes run. Needs the extra `rl` (gymnasium, pettingzoo).
"""

from vpsci_ros.errors import require

require("gymnasium")
import gymnasium  # noqa: E402

ENV_ID = "vpsci_ros/RightTurn-v0"


def register() -> None:
    """Make `ENV_ID` known to Gymnasium; importing this package does it."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(
            id=ENV_ID,
            entry_point="vpsci_ros.envs.right_turn:RightTurnEnv",
            vector_entry_point="vpsci_ros.envs.vector:RightTurnVectorEnv",
        )


register()

__all__ = ["ENV_ID", "register"]
