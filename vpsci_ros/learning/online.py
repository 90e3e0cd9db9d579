"""Stage 2 in one process: world, monitor, policies and learner called in turn, as the graph of nodes runs them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import polars as pl

from vpsci_ros.evaluation.outcomes import Outcomes, measure_outcomes
from vpsci_ros.learning.pretrain import Report, write_log
from vpsci_ros.learning.refine import CHECKPOINT, Refiner
from vpsci_ros.learning.training_config import RefineConfig, require_learnable
from vpsci_ros.learning.transitions import TransitionBuilder
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.policy.weights import Weights
from vpsci_ros.runs.identity import require_same
from vpsci_ros.world.loop import Loop

LOG, EPISODES = "refine_log.csv", "refine_episodes.csv"
VALIDATION_SEED = 4242  # of the validation world, whose other parameters are those of training
VALIDATION_EPISODES = 50  # of each scenario, or as many as training has
VALIDATE_EVERY = 3  # portions


def refine(
    near_misses: pl.DataFrame,
    config: RefineConfig,
    weights: Weights,
    simulation: SimulationConfig,
    *,
    learner_seed: int | None = None,
    out_dir: str | Path,
    report: Callable[[Report], None] | None = None,
) -> Weights:
    """Simulate episodes, learn from them, and write `refined.safetensors` and logs to `out_dir`.

    Episodes run in portions of four batches; from a checkpoint after each portion a stopped run resumes to the same
    result. The training ends early where the convergence test of section 4.1 is passed. After every third portion and
    the last one the mean actors act in a validation world without exploration (`validation_...` in the log); nothing is
    chosen by it.

    :param learner_seed: of sampling; None: the simulation's.
    :param report: called after every portion with the learner's summary and the rates of Table 5; may raise `Stopped`.
    :raises InvalidInput: as `Refiner` and `require_learnable`, or a checkpoint of another run is in `out_dir`.
    :raises DivergedError: a loss or a reward weight is not finite.
    """
    require_learnable(simulation.world)
    out_dir = Path(out_dir)
    out_dir.mkdir(parents=True, exist_ok=True)
    learner_seed = simulation.seed if learner_seed is None else learner_seed
    refiner = Refiner(config, weights, near_misses, seed=learner_seed, out_dir=out_dir)
    identity, episodes = simulation.identity(), simulation.episodes
    portion, done, rows = 4 * simulation.batch, 0, []
    outcomes = Outcomes(simulation.world, simulation.scenarios)
    builder = TransitionBuilder(simulation.world, simulation.scenarios)
    if (out_dir / CHECKPOINT).exists():
        extra = refiner.restore(out_dir / CHECKPOINT)
        require_same(out_dir / CHECKPOINT, {"simulation": extra.get("simulation")}, {"simulation": identity})
        done, rows = extra["done"], extra["rows"]
        outcomes.outcomes, outcomes.least_curvttc = extra["outcomes"], extra["least_curvttc"]
    while done < len(episodes) and not refiner.finished:
        part = episodes[done : done + portion]
        _simulate(simulation, part, refiner, builder, outcomes)
        done += len(part)
        rows.append(refiner.summary() | outcomes.rates(1000))
        if done % (VALIDATE_EVERY * portion) == 0 or done == len(episodes) or refiner.finished:
            rows[-1] |= validation_rates(simulation, refiner.averaged())
        extra = {"done": done, "rows": rows, "simulation": identity}
        extra |= {"outcomes": outcomes.outcomes, "least_curvttc": outcomes.least_curvttc}
        write_log(out_dir / LOG, rows)
        write_log(out_dir / EPISODES, refiner.progress.episode_returns)
        refiner.save_checkpoint(out_dir / CHECKPOINT, extra)  # last: what goes on from it does not write them again
        if report is not None:
            report({"simulated": float(done), "episodes_wanted": float(len(episodes))} | rows[-1])
    refined = refiner.save()
    (out_dir / CHECKPOINT).unlink(missing_ok=True)
    return refined


def validation_rates(simulation: SimulationConfig, policy: Policy | None) -> dict[str, float]:
    """Return the rates of Table 5 in the validation world, named `validation_...`.

    :param simulation: the configuration of the training.
    :param policy: of both agents; None: nobody reacts.
    """
    count = min(VALIDATION_EPISODES, 1 + max(number for _, number in simulation.episodes))
    episodes = [(scenario.number, number) for number in range(count) for scenario in simulation.scenarios]
    world = replace(simulation, episodes=episodes, batch=min(256, len(episodes)), seed=VALIDATION_SEED, policies={})
    return {f"validation_{name}": rate for name, rate in measure_outcomes(policy, world).rates().items()}


def _simulate(
    simulation: SimulationConfig,
    episodes: Sequence[tuple[int, int]],
    refiner: Refiner,
    builder: TransitionBuilder,
    outcomes: Outcomes,
) -> None:
    world = simulation.make_world(episodes)
    agents = policies(refiner.acting(), world, simulation.policies)
    for step in Loop(world, agents):
        outcomes.note(step)
        transitions, histories = builder.observe(step)
        refiner.take(histories, len(transitions))
        while refiner.due:
            refiner.update()
        if refiner.take_refresh():
            for agent in agents.values():
                agent.load(refiner.acting(), refiner.progress.version)
