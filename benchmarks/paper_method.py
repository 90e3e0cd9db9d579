"""The paper's method by `params/paper_stage1.yaml` and `paper_stage2.yaml`: collisions of each seed and each change.

    python benchmarks/paper_method.py [--arms base one_critic ...] [--seeds 4 5 6 7 8] [-o out/paper_method]

First the controls: no reaction, and untrained networks, which repeat the acceleration, which fades. Then a line for
stage 1 and one for stage 2 of each arm and seed: collisions and goals on the road of the critical episodes among 1,000
in the paper's scenes (seed 909090, without exploration), with 95% Wilson intervals, and over several seeds the median.
A training that the output folder holds is not repeated. Some six minutes of a core for each arm and seed.
"""

import argparse
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple
from unittest import mock

import torch

from vpsci_ros.cli.options import read_sections
from vpsci_ros.cli.stage_inputs import stage_1_inputs, stage_2_inputs, stage_2_parameters
from vpsci_ros.evaluation.outcomes import measure_outcomes, rates_with_intervals
from vpsci_ros.learning import networks, objectives
from vpsci_ros.learning.online import refine
from vpsci_ros.learning.pretrain import WEIGHTS as FIRST
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.refine import WEIGHTS as SECOND
from vpsci_ros.learning.training_config import UpdatesConfig
from vpsci_ros.policy import sst
from vpsci_ros.policy.policy_config import FADING, NetworkConfig
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.policy.weights import load_weights

STAGE_1, STAGE_2 = Path("paper_stage1"), Path("paper_stage2")
SEEDED = ("learner", "world_simulator", "vehicle_policy", "pedestrian_policy")
WORLD, EPISODES = 909090, 125  # seed, and episodes of each scenario


class Arm(NamedTuple):
    """One change to the method.

    :ivar first: settings of stage 1, as `--set` takes them.
    :ivar updates: returns the constants of stage 2's updates with the change.
    :ivar patch: the change where it is one of code, while both stages learn.
    """

    first: tuple[str, ...] = ()
    updates: Callable[[UpdatesConfig], UpdatesConfig] = lambda updates: updates
    patch: Callable[[], AbstractContextManager[Any]] = nullcontext


@contextmanager
def no_gate() -> Iterator[None]:
    """The networks do not see CurvTTC: the gain of the gate of (4) begins, and stays, at 0."""
    begin = sst.SSTLayer.__init__

    def without(self: sst.SSTLayer, config: NetworkConfig) -> None:
        begin(self, config)
        self.risk_gain.data.zero_()

    with mock.patch.object(sst.SSTLayer, "__init__", without), mock.patch.object(sst, "risk", torch.zeros_like):
        yield


ARMS = {
    "base": Arm(),
    "short_stage_1": Arm(("learner.episodes=400", "learner.updates.actor_learning_rate=1e-3")),
    "one_critic": Arm(updates=lambda updates: replace(updates, critics=1, target_noise=0.0)),
    # the mean |Q| of a batch, in hundreds of reward, stays far below 1
    "no_division": Arm(patch=lambda: mock.patch.object(objectives, "LEAST_VALUE", 1.0)),
    "no_gate": Arm(patch=no_gate),
    "no_fading": Arm(patch=lambda: mock.patch.object(networks, "FADING", dict.fromkeys(FADING, 0.0))),
}


def learned(name: str, seed: int, folder: Path) -> list[Path]:
    """Return the weights of both stages by an arm, in `folder`; learn what is not there."""
    arm, first, second = ARMS[name], folder / "pretrain" / FIRST, folder / "refine" / SECOND
    with arm.patch():
        if not first.exists():
            _, config, network, corpus, _ = stage_1_inputs(read_sections(STAGE_1, list(arm.first)))
            pretrain(corpus, config, network, seed=seed, out_dir=first.parent)
        if not second.exists():
            settings = [f"learner.weights={first}", *(f"{node}.seed={seed}" for node in SEEDED)]
            _, own, simulation, weights, corpus, *_ = stage_2_inputs(read_sections(STAGE_2, settings))
            own = replace(own, updates=arm.updates(own.updates))
            refine(corpus, own, weights, simulation, learner_seed=seed, out_dir=second.parent)
    return [first, second]


def measured(title: str, policy: Policy | None) -> float:
    """Print the line of a policy; None: no reaction. Return the share of collisions."""
    _, _, simulation = stage_2_parameters(read_sections(STAGE_2, []))
    episodes = [(scenario.number, number) for number in range(EPISODES) for scenario in simulation.scenarios]
    world = replace(simulation, episodes=episodes, batch=512, seed=WORLD, policies={})
    row = rates_with_intervals(measure_outcomes(policy, world))
    shares = (100.0 * row[f"{end}_{part}"] for end in ("collision", "goal") for part in ("rate", "low", "high"))
    text = "collisions {:.1f} [{:.1f}, {:.1f}], goals on the road {:.1f} [{:.1f}, {:.1f}]".format(*shares)
    print(f"{title:>30}: {text}, n = {row['critical_episodes']:.0f}", flush=True)
    return row["collision_rate"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("out", "paper_method"))
    parser.add_argument("--arms", nargs="+", default=["base"], choices=list(ARMS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[4, 5, 6, 7, 8])
    given = parser.parse_args()
    measured("no reaction, in the lane", None)
    torch.manual_seed(0)
    measured("untrained", networks.Networks(NetworkConfig()).weights({}, {}))
    for arm in given.arms:
        shares = []
        for seed in given.seeds:
            first, second = learned(arm, seed, given.output / f"{arm}_{seed}")
            measured(f"{arm}, seed {seed}, stage 1", load_weights(first))
            shares.append(measured(f"{arm}, seed {seed}, stage 2", load_weights(second)))
        print(f"{arm}: median of {len(shares)} seeds {100.0 * median(shares):.1f}%", flush=True)


if __name__ == "__main__":
    main()
