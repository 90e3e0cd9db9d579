"""What each part of stage 2 does: one change at a time, from one stage 1, in a quarter of the episodes.

    python benchmarks/ablation.py --weights out/weights/pretrain/pretrained.safetensors [-o out/ablation]
        [--arms base no_hand_back ...] [--seeds 2 3 4] [--workers 4 | --cluster tcp://host:8786]

Stage 2 has 1,200 episodes, from the weights of a whole stage 1. A line for each arm and seed: collisions and goals on
the road in the validation world, the mean of its last two measurements (some 340 critical episodes each, on which
nothing was chosen), the closed-loop ADE on held-out clips, and the Brier score of who goes first on right_turns/dev.
The first two lines are controls: agents without any reaction (for the error: with the last velocity repeated), and the
weights of stage 1. `front.png` shows all arms. An arm that the output folder holds is not repeated. Some two minutes
of a core for each arm and seed.
"""

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import polars as pl

from vpsci_ros.cli.options import read_sections, site_of
from vpsci_ros.cli.stages import stage_2_inputs
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.evaluation.onsets import find_onsets
from vpsci_ros.evaluation.simulators import policy as simulator
from vpsci_ros.evaluation.simulators import tracked
from vpsci_ros.extras.paper.realism.order import likeness
from vpsci_ros.learning import closed_loop
from vpsci_ros.learning import refine as stage_2
from vpsci_ros.learning.online import LOG, refine, validation_rates
from vpsci_ros.learning.training_config import RefineConfig
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.report.canvas import new_figure, save_png
from vpsci_ros.resources import TO_MEASURE_ON
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.workers import Place, Work, computed

PARAMS = Path("stage2_online")  # of the package, wherever it is installed
SEEDED = ("learner", "world_simulator", "vehicle_policy", "pedestrian_policy")
EPISODES = 150  # of each scenario
RATES = ("validation_collision_rate", "validation_goal_rate", "held_out_closed_loop_ade")
LAST = 2  # measurements in the validation world that are averaged


class Arm(NamedTuple):
    """One change to stage 2.

    :ivar changed: returns the configuration of the learner with the change.
    :ivar settings: parameters of other nodes, as `--set` takes them.
    :ivar patch: the change where it is one of code, while the arm learns.
    """

    changed: Callable[[RefineConfig], RefineConfig] = lambda config: config
    settings: tuple[str, ...] = ()
    patch: Callable[[], AbstractContextManager[Any]] = nullcontext


def _learner(**values: Any) -> Arm:
    return Arm(lambda config: replace(config, **values))


def _rolled(**values: Any) -> Arm:
    return Arm(lambda config: replace(config, closed_loop=replace(config.closed_loop, **values)))


ARMS = {
    "base": Arm(),
    "ddpg": _learner(objective="ddpg"),
    # An offset of 100 m makes the price of nearness linear; 0.06 of it is what 6 is without.
    "linear_price": Arm(
        _rolled(contact=0.06).changed, patch=lambda: mock.patch.object(closed_loop, "NEAR_OFFSET", 100.0)
    ),
    "no_hand_back": _rolled(beyond=0),
    "no_imitation": _rolled(weight=0.2, most_weight=0.2),
    **{f"limit_{limit:g}": _rolled(limit=limit) for limit in (0.25, 0.3)},
    **{f"steps_{steps}": _rolled(steps=steps) for steps in (25, 60)},
    "late_0": _rolled(late=0.0),
    "lane_0": _rolled(lane=0.0),
    **{f"updates_{each:g}": _learner(updates_per_episode=each) for each in (0.1, 0.5)},
    "last_actors": Arm(patch=lambda: mock.patch.object(stage_2, "MEAN_REFRESHES", 1)),
}


def brier(weights: Weights | None) -> float:
    """Return the Brier score of who goes first on `TO_MEASURE_ON`; None: no reaction."""
    onsets = find_onsets(read_near_misses(TO_MEASURE_ON))
    return likeness(tracked if weights is None else simulator(weights, 0), onsets)[0]


def controls(stage_1: Path) -> list[tuple[str, list[float], float]]:
    """Return name, rates (`RATES`), Brier score and number of critical episodes of no reaction and of stage 1."""
    settings = [f"learner.weights={stage_1}", f"world_simulator.episodes={EPISODES}"]
    _, _, simulation, *_ = stage_2_inputs(read_sections(PARAMS, settings))
    rows, weights = [], load_weights(stage_1)
    for name, policy, errors in (("no reaction", None, "control"), ("stage 1", weights, "errors")):
        rates = validation_rates(simulation, policy) | {
            "held_out_closed_loop_ade": weights.facts["held_out"][errors]["closed_loop_ade"]
        }
        own = [*(rates[rate] for rate in RATES), brier(policy)]
        rows.append((name, own, rates["validation_critical_episodes"]))
    return rows


def learner(stage_1: Path, place: Place) -> Callable[[tuple[str, int]], None]:
    """Return a function that learns an arm with a seed, (name, seed), into its folder."""
    weights = place.path(str(stage_1))
    return lambda arm: learn(*arm, weights, place.folder / "{}_{}".format(*arm))


def learn(name: str, seed: int, stage_1: str, folder: Path) -> None:
    """Learn an arm into `folder`, unless that is done."""
    arm = ARMS[name]
    if not (folder / "done").exists():
        seeds = [f"{node}.seed={seed}" for node in SEEDED]
        settings = [f"learner.weights={stage_1}", f"world_simulator.episodes={EPISODES}", *seeds, *arm.settings]
        sections = read_sections(PARAMS, settings)
        _, config, simulation, weights, corpus, *_ = stage_2_inputs(sections)
        with arm.patch():
            refine(corpus, arm.changed(config), weights, simulation, learner_seed=seed, out_dir=folder)
        (folder / "done").touch()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", type=Path, required=True, help="of a whole stage 1, see tools/make_weights.py")
    parser.add_argument("-o", "--output", type=Path, default=Path("out", "ablation"))
    parser.add_argument("--arms", nargs="+", default=list(ARMS), choices=list(ARMS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[2])
    parser.add_argument("--workers", type=int, help="trainings side by side")
    parser.add_argument("--cluster", metavar="ADDRESS", default=os.environ.get("DASK_SCHEDULER_ADDRESS"))
    given = parser.parse_args()
    stage_1, site = given.weights.absolute(), site_of(given.workers, given.cluster, mixed_cpus=False)
    print(f"stage 1: {sha256(given.weights)[:12]}; {software_versions()}")
    points = []
    print(f"{'arm':>24} seed  collisions  goals  closed-loop ADE [m]  Brier  validation episodes")
    for name, rates, counted in controls(given.weights):
        print(line(name, "-", rates, counted), flush=True)
    arms = [(name, seed) for name in given.arms for seed in given.seeds]
    todo = [arm for arm in arms if not (given.output / "{}_{}".format(*arm) / "done").exists()]
    if todo:
        waiting, most = iter(todo), len(todo)
        work = Work(partial(learner, stage_1), given.output, most=most, reads=lambda: [stage_1])
        workers = site.start(work)
        with closing(workers):
            for number, (arm, _) in enumerate(computed(workers, lambda: next(waiting, None), ahead=False), 1):
                print(f"learned {arm}, {number} of {most} {site.hosts()}", file=sys.stderr, flush=True)
    for name in given.arms:
        for seed in given.seeds:
            log = pl.read_csv(given.output / f"{name}_{seed}" / LOG)
            last = log.filter(pl.col("validation_collision_rate").is_not_null()).tail(LAST)
            rates = [float(rate) for rate in last.select(RATES).mean().row(0)]
            rates.append(brier(load_weights(given.output / f"{name}_{seed}" / stage_2.WEIGHTS)))
            print(line(name, seed, rates, float(last["validation_critical_episodes"].sum())), flush=True)
            points.append((name, 100.0 * rates[0], rates[2]))
    save_front(points, given.output / "front.png")


def line(name: str, seed: object, rates: Sequence[float], counted: float) -> str:
    """Return a line of the table."""
    collisions, goals, error, order = rates
    shares = f"{name:>24} {seed:>4} {100.0 * collisions:10.1f}% {100.0 * goals:5.1f}%"
    return f"{shares} {error:20.2f} {order:6.2f} {counted:20.0f}"


def save_front(points: list[tuple[str, float, float]], path: Path) -> None:
    """Draw collisions [%] against the closed-loop ADE [m] of arms, to the lower left of which is better."""
    figure, axes = new_figure(7.0, 5.0)
    for name, collisions, error in points:
        axes[0, 0].plot(collisions, error, "o", color="#b5432d" if name == "base" else "#2b5c8a")
        axes[0, 0].annotate(name, (collisions, error), xytext=(4, 3), textcoords="offset points", fontsize=8)
    axes[0, 0].set(xlabel="collisions in the validation world [%]", ylabel="closed-loop ADE on held-out clips [m]")
    axes[0, 0].set(xlim=(0.0, None), ylim=(0.0, None))
    save_png(figure, path)


if __name__ == "__main__":
    main()
