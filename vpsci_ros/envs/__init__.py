"""Gymnasium environments and a PettingZoo environment to train and test driving systems.

After `import vpsci_ros.envs`, `gymnasium.make("vpsci_ros/RightTurn-v0")` makes an environment in which you drive the
vehicle and the default or a reference pedestrian reacts. `gymnasium.make_vec` makes a batch;
`parallel.parallel_env` has both agents. World, monitor and policy are those of the nodes. Needs the extra `rl`.

In reading order:

* `task`: observation, action and reward of the right-turn environment
* `right_turn`: the right turn as a Gymnasium environment: the user drives the vehicle, the pedestrian reacts
* `vector`: the right turn as a Gymnasium vector environment: a batch in one world, one call a step
* `parallel`: both agents as a PettingZoo parallel environment: equations (6)-(13) and (18)-(26) of the paper
* `simulation`: a batch of episodes with world, monitor and default pedestrian, advanced by the environment's actions
* `rendering`: an environment's scene from above as an image, north up: lane, crosswalk, vehicle
"""

from vpsci_ros.errors import require

require("gymnasium")
import gymnasium  # noqa: E402

ENV_ID = "vpsci_ros/RightTurn-v0"
if ENV_ID not in gymnasium.registry:
    gymnasium.register(
        id=ENV_ID,
        entry_point="vpsci_ros.envs.right_turn:RightTurnEnv",
        vector_entry_point="vpsci_ros.envs.vector:RightTurnVectorEnv",
    )
