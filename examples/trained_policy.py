"""A policy trained with Stable-Baselines3 in the Gymnasium environment, then put to the exam as an ADS node.

    pip install -c constraints.txt '.[ros,messages,rl,baselines]'
    python examples/trained_policy.py train out/policy.safetensors --steps 100000
    vpsci ads-test --params params/ads_test.yaml -o out/trained \
        --ads "python examples/trained_policy.py drive out/policy.safetensors"

The node observes what the environment shows: it makes the observation of `/world/state` by the same function. So it
knows where the pedestrian truly is, whatever perception says, and knows the package's own scenarios only.

The same in one process, many episodes side by side, with the weights that `TRAINED_POLICY` names:

    TRAINED_POLICY=out/policy.safetensors PYTHONPATH=examples vpsci ads-test --params params/ads_test.yaml \
        -o out/trained --ads-class trained_policy:PolicyDriver
"""

import argparse
import contextlib
import functools
import os
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import DummyVecEnv

from vpsci_ros.envs import task
from vpsci_ros.envs.right_turn import ACTION_SPACE, OBSERVATION_SPACE, RightTurnEnv
from vpsci_ros.wire.world_state import read_world_state
from vpsci_ros.world import IDLE, load_scenarios
from vpsci_ros.world.monitor import assess
from vpsci_ros.world.scenario import further_files, scenario_files
from vpsci_ros.world.tables import tables_from

ENVIRONMENTS = 8
HOLD = 2  # ticks for which an action holds: the environment's step of 0.1 s


def train(path: Path, steps: int, scenarios: list[int], seed: int, pedestrian: str) -> None:
    """Train with PPO against a pedestrian of `RightTurnEnv`, and save the policy's weights."""
    path.parent.mkdir(parents=True, exist_ok=True)
    made = [lambda: RightTurnEnv(scenarios, pedestrian=pedestrian) for _ in range(ENVIRONMENTS)]
    model = PPO("MlpPolicy", DummyVecEnv(made), n_steps=256, batch_size=512, gamma=0.98, seed=seed, device="cpu")
    model.learn(steps)
    save_file(model.policy.state_dict(), path)


def load(path: Path) -> ActorCriticPolicy:
    """Return a policy with the weights of a file."""
    policy = ActorCriticPolicy(OBSERVATION_SPACE, ACTION_SPACE, lr_schedule=lambda _: 0.0)
    policy.load_state_dict(load_file(path))
    return policy.eval()


class Driver:
    """What the policy does with one row of the world's state after the other."""

    def __init__(self, policy: ActorCriticPolicy) -> None:
        scenarios = load_scenarios([*scenario_files(), *further_files()])
        self._policy = policy
        self._tables = tables_from(scenarios)
        self._row_of = {scenario.number: row for row, scenario in enumerate(scenarios)}
        self._held = np.zeros(3)

    def control(self, state: np.ndarray) -> np.ndarray:
        """Return (steer, throttle, brake) for EPISODE[P], of one vehicle and P pedestrians.

        They are chosen at every second frame and held at the others. As in the environment, the pedestrian that is
        observed is the one whose CurvTTC is least.
        """
        if state["status"][0] == IDLE:  # between two episodes
            return np.zeros(3)
        if state["frame"][0] % HOLD == 0:
            state["table"] = self._row_of[int(state["scenario"][0])]
            path = self._tables.lane[state["table"][0]][: self._tables.rows["lane_count"][state["table"][0]]]
            place = np.hypot(*(path - [state["vehicle_x"][0], state["vehicle_y"][0]]).T).argmin()
            state["route_s"] = place * self._tables.rows["lane_step"][state["table"][0]]
            curvttc = assess(state)[0]
            observation = task.observe(state, curvttc, self._tables)[[curvttc.argmin()]]
            action, _ = self._policy.predict(observation, deterministic=True)
            self._held = task.controls(action)[0]
        return self._held


class PolicyDriver:
    """The policy as a class for `--ads-class`: an object drives one car, and all of them share the weights."""

    def reset(self, begin: Any) -> None:
        """Begin an episode."""
        self._policy, self._tick = shared_policy(os.environ.get("TRAINED_POLICY", "out/policy.safetensors")), 0

    def act(self, observation: Any) -> np.ndarray:
        """Return steer, throttle and brake, chosen at every second tick and held at the others."""
        if self._tick % HOLD == 0:
            action, _ = self._policy.predict(observation.of_environment()[None], deterministic=True)
            self._held = task.controls(action)[0]
        self._tick += 1
        return self._held


@functools.cache
def shared_policy(path: str) -> ActorCriticPolicy:
    """Return the policy of a file, which is read once in a process."""
    torch.set_num_threads(1)
    return load(Path(path))


def drive(path: Path) -> None:
    """Answer every tick of the world on `/vehicle/cmd_control` until stopped."""
    import rclpy
    from rclpy.executors import ExternalShutdownException

    from vpsci_msgs.msg import VehicleControl, WorldState

    rclpy.init()
    node, driver = rclpy.create_node("trained_policy"), Driver(load(path))
    command = node.create_publisher(VehicleControl, "vehicle/cmd_control", 10)

    def on_state(data: bytes) -> None:
        header, tick, _ = read_world_state(data)
        steer, throttle, brake = (float(value) for value in driver.control(tick.state))
        answer = VehicleControl(tick=tick.number, steer=steer, throttle=throttle, brake=brake)
        answer.header.stamp.sec, answer.header.stamp.nanosec = header.seconds, header.nanoseconds
        answer.header.frame_id = header.frame_id
        if rclpy.ok():  # it was not shut down while the policy thought
            command.publish(answer)

    node.create_subscription(WorldState, "world/state", on_state, 10, raw=True)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    rclpy.try_shutdown()


def main() -> None:
    """Train, or drive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["train", "drive"])
    parser.add_argument("weights", type=Path, help="safetensors file, written or read")
    parser.add_argument("--steps", type=int, default=100_000, help="of 0.1 s, of all environments together")
    parser.add_argument("--scenarios", type=int, nargs="+", default=[1, 5, 101, 102])
    parser.add_argument("--pedestrian", default="policy", help="policy: learned, reacts; autopilot: walks on")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.what == "train":
        train(given.weights, given.steps, given.scenarios, given.seed, given.pedestrian)
    else:
        drive(given.weights)


if __name__ == "__main__":
    main()
