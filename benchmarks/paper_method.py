"""The paper's method by `params/paper_stage1.yaml` and `paper_stage2.yaml`: each seed, change, model and reward weight.

    python benchmarks/paper_method.py [--arms base one_critic ...] [--seeds 4 5 6 7 8] [-o out/paper_method]
        [--weights people out/weights/refine/refined.safetensors ...]

A line for each policy: collisions and goals on the road of the critical episodes among 1,000 in the paper's scenes
(seed 909090, without exploration) with 95% Wilson intervals; on `right_turns/dev` the Brier score of who goes first and
the energy score as a ratio to constant velocity's; and networks' ADE in closed loop and in reconstruction on the clips
that training held out. First the controls: no reaction, and untrained networks, which repeat the acceleration, which
fades. Then `--weights`, and stages 1 and 2 of each arm and seed; over several seeds the median and range of stage 2.
A training that the output folder holds is not repeated. Some five minutes of a core for each arm and seed, two where
the arm has base's stage 1.
"""

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple
from unittest import mock

import torch

from vpsci_ros.cli.options import read_sections
from vpsci_ros.cli.stages import stage_1_inputs, stage_2_inputs, stage_2_parameters
from vpsci_ros.data.corpus import held_out_by
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.evaluation.held_out import HeldOut
from vpsci_ros.evaluation.onsets import Onsets, find_onsets
from vpsci_ros.evaluation.outcomes import measure_outcomes
from vpsci_ros.evaluation.simulators import policy as simulator
from vpsci_ros.evaluation.simulators import tracked
from vpsci_ros.extras.paper.rates import rates_with_intervals
from vpsci_ros.extras.paper.realism.order import likeness
from vpsci_ros.learning import networks, objectives
from vpsci_ros.learning.online import refine
from vpsci_ros.learning.pretrain import WEIGHTS as FIRST
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.refine import WEIGHTS as SECOND
from vpsci_ros.learning.training_config import RefineConfig
from vpsci_ros.policy import sst
from vpsci_ros.policy.policy_config import FADING, NetworkConfig
from vpsci_ros.policy.policy_file import Policy, load_policy
from vpsci_ros.policy.weights import Weights
from vpsci_ros.resources import TO_MEASURE_ON

STAGE_1, STAGE_2 = Path("paper_stage1"), Path("paper_stage2")
SEEDED = ("learner", "world_simulator", "vehicle_policy", "pedestrian_policy")
WORLD, EPISODES = 909090, 125  # seed, and episodes of each scenario
PERCENT = 100.0
NAMES = ("collisions", "goals", "Brier", "energy", "closed-loop ADE", "reconstruction ADE")


class Arm(NamedTuple):
    """One change to the method.

    :ivar first: settings of stage 1, as `--set` takes them; None: the arm goes on from the stage 1 of `base`.
    :ivar second: returns the configuration of stage 2 with the change.
    :ivar patch: the change where it is one of code, while the arm learns.
    """

    first: tuple[str, ...] | None = ()
    second: Callable[[RefineConfig], RefineConfig] = lambda config: config
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


def _one_critic(config: RefineConfig) -> RefineConfig:
    return replace(config, updates=replace(config.updates, critics=1, target_noise=0.0))


def _weighted(*weights: float) -> Arm:
    return Arm(None, lambda config: replace(config, rewards=replace(config.rewards, weights=list(weights))))


def _model(name: str, objective: str) -> Arm:
    settings = (f"learner.encoder={name}", f"learner.objective={objective}")
    return Arm(settings, lambda config: replace(config, objective=objective))


ARMS = {
    "base": Arm(),
    "short_stage_1": Arm(("learner.episodes=400", "learner.updates.actor_learning_rate=1e-3")),
    "one_critic": Arm(None, _one_critic),  # stage 1 has one, and no noise
    # The mean |Q| of a batch, in hundreds of reward, stays far below 1. Stage 1 still divides.
    "no_division": Arm(None, patch=lambda: mock.patch.object(objectives, "LEAST_VALUE", 1.0)),
    "no_gate": Arm(patch=no_gate),
    "no_fading": Arm(patch=lambda: mock.patch.object(networks, "FADING", dict.fromkeys(FADING, 0.0))),
    # Table 9
    "ma_transformer_ddpg": _model("ma_transformer_ddpg", "ddpg"),
    "ma_ddpg": _model("ma_ddpg", "ddpg"),
    "transformer_ddpg": _model("transformer_ddpg", "single_agent_ddpg"),
    "ddpg": _model("ddpg", "single_agent_ddpg"),
    # Table 5; base has adaptive weights
    "equal": _weighted(0.33, 0.33, 0.33),
    "safety": _weighted(0.6, 0.2, 0.2),
    "goal": _weighted(0.2, 0.6, 0.2),
    "speed": _weighted(0.2, 0.2, 0.6),
}


def learned(name: str, seed: int, output: Path) -> list[Path]:
    """Return the weights of both stages by an arm, in its folder of `output`; learn what is not there."""
    arm, folder = ARMS[name], output / f"{name}_{seed}"
    begun = folder if arm.first is not None else output / f"base_{seed}"
    first, second = begun / "pretrain" / FIRST, folder / "refine" / SECOND
    if arm.first is None:
        learned("base", seed, output)
    with arm.patch():
        if not first.exists():
            settings = [f"learner.seed={seed}", *(arm.first or ())]
            _, config, network, corpus, _ = stage_1_inputs(read_sections(STAGE_1, settings))
            pretrain(corpus, config, network, seed=seed, out_dir=first.parent)
        if not second.exists():
            settings = [f"learner.weights={first}", *(f"{node}.seed={seed}" for node in SEEDED)]
            _, own, simulation, weights, corpus, *_ = stage_2_inputs(read_sections(STAGE_2, settings))
            refine(corpus, arm.second(own), weights, simulation, learner_seed=seed, out_dir=second.parent)
    return [first, second]


@cache
def recorded() -> tuple[Onsets, HeldOut]:
    """Return the onsets of `TO_MEASURE_ON`, and the near misses that every training holds out."""
    held_out = held_out_by(stage_1_inputs(read_sections(STAGE_1, []))[3], [])[1]
    return find_onsets(read_near_misses(TO_MEASURE_ON)), HeldOut(held_out)


def measured(title: str, policy: Policy | None) -> list[float]:
    """Print the line of a policy; None: no reaction. Return its numbers, named in `NAMES`."""
    _, _, simulation = stage_2_parameters(read_sections(STAGE_2, []))
    episodes = [(scenario.number, number) for number in range(EPISODES) for scenario in simulation.scenarios]
    world = replace(simulation, episodes=episodes, batch=512, seed=WORLD, policies={})
    row = rates_with_intervals(measure_outcomes(policy, world))
    shares = [PERCENT * row[f"{end}_{part}"] for end in ("collision", "goal") for part in ("rate", "low", "high")]
    onsets, held_out = recorded()
    brier, energy = likeness(tracked if policy is None else simulator(policy, 0), onsets)
    errors = held_out.errors(policy) if isinstance(policy, Weights) else {} if policy else held_out.control
    ades = [errors.get(f"{protocol}_ade", math.nan) for protocol in ("closed_loop", "reconstruction")]
    text = "collisions {:.1f} [{:.1f}, {:.1f}], goals {:.1f} [{:.1f}, {:.1f}]".format(*shares)
    text += f", n = {row['critical_episodes']:.0f}; Brier {brier:.3f}, energy {energy:.2f}"
    print(f"{title:>30}: {text}, ADE {ades[0]:.2f} and {ades[1]:.3f}", flush=True)
    return [shares[0], shares[3], brier, energy, *ades]


def summary(rows: Sequence[Sequence[float]]) -> str:
    """Return median and range over trainings of what `measured` returns."""
    columns = zip(NAMES, zip(*rows, strict=True), strict=True)
    return ", ".join(f"{name} {median(own):.3g} ({min(own):.3g} to {max(own):.3g})" for name, own in columns)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("out", "paper_method"))
    parser.add_argument("--arms", nargs="*", default=["base"], choices=list(ARMS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[4, 5, 6, 7, 8])
    parser.add_argument("--weights", nargs="+", default=[], help="further policies: files or shipped names")
    given = parser.parse_args()
    measured("no reaction, in the lane", None)
    torch.manual_seed(0)
    measured("untrained", networks.Networks(NetworkConfig()).weights({}, {}))
    for name in given.weights:
        measured(name, load_policy(name))
    for arm in given.arms:
        rows = []
        for seed in given.seeds:
            first, second = learned(arm, seed, given.output)
            measured(f"{arm}, seed {seed}, stage 1", load_policy(first))
            rows.append(measured(f"{arm}, seed {seed}, stage 2", load_policy(second)))
        print(f"{arm}: median and range of {len(rows)} seeds: {summary(rows)}", flush=True)


if __name__ == "__main__":
    main()
