"""Actor-steps per second of the shipped streaming kernel, and of torch doing the same job.

    python benchmarks/bench_policy.py [--threads 1]

Prints one row per way of running the actor of Table 8: numba streaming; torch streaming in the batch as it comes (whose
rows change their bits with the batch); torch streaming padded to chunks of one fixed shape (whose rows do not); and
torch over the plain ten-step window. Then a policy at work in the world, with its observation: one that draws nothing,
the same network drawing, and the shipped one drawing and at temperature 0. Figures of
a run are in docs/speed.md.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
import torch

from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.actor import Actor
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.sst import StepState
from vpsci_ros.policy.streaming import StreamingActor
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.resources import weights_path
from vpsci_ros.world import World, WorldConfig, load_scenarios

BATCHES = (1, 64, 1024, 4096)
WARM = 12  # steps before the clock starts, so that the attention window is full


def rate(step: Callable[[], object], batch: int, seconds: float = 1.5) -> float:
    """Return actor-steps per second of `step`, which takes `batch` rows one step further."""
    for _ in range(WARM):
        step()
    count, start = 0, time.perf_counter()
    while (spent := time.perf_counter() - start) < seconds:
        step()
        count += 1
    return batch * count / spent


def streamed(networks: Networks, batch: int, threads: int) -> Callable[[], object]:
    """Numba, as the nodes run it."""
    actor = StreamingActor(networks.weights({}, {}).actor("vehicle"), batch, threads)
    observation, curvttc, none, every = inputs(batch)
    return lambda: actor.step(observation, curvttc, none, every)


def torch_streamed(networks: Networks, batch: int, chunk: int) -> Callable[[], object]:
    """Torch with carried state, in chunks of `chunk` rows (the last one padded), or as one batch where chunk is 0."""
    actor: Actor = networks.actor["vehicle"]
    size = chunk or batch
    observation, curvttc, *_ = inputs(size)
    args = torch.from_numpy(observation), torch.zeros(size, 2), torch.from_numpy(curvttc)
    states: list[list[StepState]] = [actor.empty_history() for _ in range(-(-batch // size))]

    def step() -> None:
        with torch.inference_mode():
            for state in states:
                actor.step(*args, state)

    return step


def torch_window(networks: Networks, batch: int) -> Callable[[], object]:
    """Torch over ten steps for every new one."""
    actor = networks.actor["vehicle"]
    observation, curvttc, *_ = inputs(batch)
    whole = torch.from_numpy(np.repeat(observation[:, None], 10, axis=1)), torch.zeros(batch, 10, 2)
    risks = torch.from_numpy(np.repeat(curvttc[:, None], 10, axis=1))

    def step() -> None:
        with torch.inference_mode():
            actor(*whole, risks)

    return step


def at_work(weights: Weights, batch: int, temperature: float) -> Callable[[], object]:
    """One agent of `batch` episodes in which the policies act."""
    agent = PolicyAgent("vehicle", 1, explore=False, temperature=temperature)
    agent.load(weights, version=1)
    now = World(WorldConfig(), load_scenarios([1]), [(1, i) for i in range(batch)], batch, 1).now
    now.state["controlled"] = 1
    assessment = now.assessed(np.full(batch, 2.0), np.full(batch, 2.0), np.ones(batch, bool))
    return lambda: agent.act(now, assessment)


def inputs(batch: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return observation, CurvTTC, reset and active for `batch` rows."""
    observation = np.random.default_rng(0).normal(size=(batch, 6)).astype(np.float32)
    return observation, np.full(batch, 3.0), np.zeros(batch, bool), np.ones(batch, bool)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=1)
    threads = parser.parse_args().threads
    torch.set_num_threads(threads)
    networks, drawing = Networks(NetworkConfig()), Networks(NetworkConfig(latent=8)).weights({}, {})
    shipped = load_weights(weights_path("refined"))
    ways: dict[str, Callable[[int], Callable[[], object]]] = {
        "numba streamed (shipped)": lambda b: streamed(networks, b, threads),
        "torch streamed, any shape": lambda b: torch_streamed(networks, b, 0),
        "torch streamed, padded to 32": lambda b: torch_streamed(networks, b, 32),
        "torch streamed, padded to 64": lambda b: torch_streamed(networks, b, 64),
        "torch ten-step window": lambda b: torch_window(networks, b),
        "at work, draws nothing": lambda b: at_work(networks.weights({}, {}), b, 1.0),
        "at work, draws": lambda b: at_work(drawing, b, 1.0),
        "at work, shipped, draws": lambda b: at_work(shipped, b, 1.0),
        "at work, shipped, its middle": lambda b: at_work(shipped, b, 0.0),
    }
    print(f"actor-steps/s, {threads} thread(s)")
    print(f"{'':30s}" + "".join(f"{f'B = {b:,}':>14s}" for b in BATCHES))
    for name, way in ways.items():
        print(f"{name:30s}" + "".join(f"{rate(way(b), b):14,.0f}" for b in BATCHES), flush=True)


if __name__ == "__main__":
    main()
