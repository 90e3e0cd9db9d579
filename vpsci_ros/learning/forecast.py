"""A forecast for a bank, learned from near misses: stage 1 trained five times, and its roll-outs by a small network.

Stage 1 is trained on all clips and on all but one of four parts of them. The small networks of `policy.forecast` learn
what the actors of a training do in the 3 s after recorded situations, and after situations near these. The network
for new situations learns the mean of all five trainings. A recorded reaction has the forecast by the training that has
not seen its clip, so that what is left of the reaction is as large as it will be for new ones.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
import torch
from numpy.typing import NDArray

from vpsci_ros.data.corpus import NO_CLIPS, table_hash
from vpsci_ros.data.near_misses import MOTION
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.roll_out import Seen, roll_out
from vpsci_ros.evaluation.scene import Scene
from vpsci_ros.learning.adam import Adam
from vpsci_ros.learning.one_thread import one_thread
from vpsci_ros.learning.pretrain import WEIGHTS, pretrain
from vpsci_ros.learning.training_config import PretrainConfig
from vpsci_ros.policy.bank import SLOWEST
from vpsci_ros.policy.forecast import ACTIONS, STEPS, CrossFitted, Networks
from vpsci_ros.policy.make_bank import recorded_situations
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.stepped import actor_at_work
from vpsci_ros.policy.weights import Weights, load_weights, resolved
from vpsci_ros.runs.identity import require_same
from vpsci_ros.world.observation import AGENTS, STEP

PARTS = 4  # of the clips, each unseen by one training
MOST = 12_000  # recorded steps that the small networks learn from
SPREAD = 0.0, 0.3, 0.8  # standard deviations of situations by which those are varied
WIDTH, UPDATES, BATCH, RATE = 64, 12_000, 512, 2e-3
JERK = 3e-3  # [s4] weight of squared errors of accelerations beside those of places

Floats = NDArray[np.float64]
Report = Callable[[str, dict[str, float]], None]


def learn_forecast(
    table: pl.DataFrame, config: PretrainConfig, network: NetworkConfig, *, seed: int, folder: Path, report: Report
) -> CrossFitted:
    """Return the forecast of near misses; a stopped call resumes from what it left in `folder`.

    :param table: near misses of one source.
    :param config, network: of stage 1; `config.held_out_clips` is not read.
    :param seed: of the parts, the trainings and the small networks.
    :param report: called after each iteration with the training's name and what `pretrain` reports.
    :raises InvalidInput: fewer clips than parts, or as `pretrain`.
    """
    names = pl.concat_str("source", "clip", separator="/")
    clips = table.select(names.unique().sort()).to_series().to_list()
    if len(clips) < PARTS:
        raise InvalidInput(f"forecast: expected near misses of at least {PARTS} clips, got {len(clips)}")
    part_of = {clips[i]: 1 + k % PARTS for k, i in enumerate(np.random.default_rng(seed).permutation(len(clips)))}
    config = replace(config, held_out_clips=[NO_CLIPS])
    trained = []
    for number in range(1 + PARTS):
        unseen = [clip for clip, part in part_of.items() if part == number]
        name, seen = f"part{number}" if number else "all", table.filter(~names.is_in(unseen))
        trained.append(_trained(seen, config, network, seed, folder / name, partial(report, name)))
    situations = _situations(table, seed)
    acted = [roll_outs(weights, situations) for weights in trained]
    acted[0] = np.mean(acted, axis=0)
    fitted = [_fit(situations, actions, seed) for actions in acted]
    return CrossFitted(Networks(*(np.stack(arrays) for arrays in zip(*fitted, strict=True))), part_of)


def _trained(
    table: pl.DataFrame,
    config: PretrainConfig,
    network: NetworkConfig,
    seed: int,
    folder: Path,
    report: Callable[[dict[str, float]], None],
) -> Weights:
    """Return the weights of stage 1 in `folder`, which are trained unless they are there.

    :raises InvalidInput: those that are there are of other near misses, parameters or another seed.
    """
    if (folder / WEIGHTS).exists():
        weights = load_weights(folder / WEIGHTS)
        there = {
            "configuration": weights.configuration,
            "seed": weights.facts.get("seed"),
            "data": weights.facts["data"]["sha256"],
        }
        require_same(
            str(folder), there, {"configuration": resolved(config, network), "seed": seed, "data": table_hash(table)}
        )
        return weights
    return pretrain(table, config, network, seed=seed, out_dir=folder, report=report)


def _situations(table: pl.DataFrame, seed: int) -> Floats:
    """Return recorded situations, and varied ones, float64[n, 9]; unknown accelerations are 0."""
    rng = np.random.default_rng(seed)
    tracks = table.partition_by("interaction", maintain_order=True)
    recorded = [recorded_situations(track.select(MOTION).to_numpy()) for track in tracks if track.height > 1]
    some = rng.permutation(np.nan_to_num(np.concatenate(recorded)))[:MOST]
    varied = [some + width * some.std(axis=0) * rng.standard_normal(some.shape) for width in SPREAD]
    result: Floats = np.concatenate(varied)
    result[:, 0] = np.maximum(result[:, 0], 0.0)  # no vehicle rolls backwards
    return result


@torch.no_grad()
def roll_outs(weights: Weights, situations: Floats) -> Floats:
    """Return what both actors do in the 3 s after situations, float64[n, 9] -> float64[n, 30, 4], see `ACTIONS`.

    :param situations: see `bank.situations_of`; every number is known.
    """
    count, every = len(situations), np.ones(len(situations), np.bool_)
    fast = np.maximum(situations[:, 0], SLOWEST)
    actors = [actor_at_work(weights.actor(agent), count) for agent in AGENTS]
    vehicle = np.stack([situations[:, 1], situations[:, 2] * fast], axis=1)
    for actor, before in zip(actors, (vehicle, situations[:, 7:9]), strict=True):
        actor.executed(before.astype(np.float32), every)
    out = np.zeros((count, STEPS, ACTIONS))

    def act(seen: Seen) -> dict[str, torch.Tensor]:
        curvttc, first = seen.curvttc.numpy(), np.full(count, seen.step == 0)
        done = [
            actor.step(seen.observation[agent].numpy().astype(np.float32), curvttc, first, every).astype(np.float64)
            for agent, actor in zip(AGENTS, actors, strict=True)
        ]
        speed = np.maximum(seen.scene.vehicle_velocity.norm(dim=1).numpy(), SLOWEST)
        out[:, seen.step, :2], out[:, seen.step, 2:] = done[0], done[1]
        out[:, seen.step, 1] /= speed * speed
        return {agent: torch.from_numpy(action) for agent, action in zip(AGENTS, done, strict=True)}

    zero, numbers = torch.zeros(count, dtype=torch.float64), torch.from_numpy(situations)
    start = Scene(
        vehicle=torch.zeros((count, 2), dtype=torch.float64),
        heading=zero,
        vehicle_velocity=torch.stack([numbers[:, 0], zero], dim=1),
        curvature=torch.from_numpy(situations[:, 2] / fast),
        pedestrian=numbers[:, 3:5],
        pedestrian_velocity=numbers[:, 5:7],
    )
    for _ in roll_out(start, act, [count] * STEPS):
        continue
    return out


@one_thread()
def _fit(situations: Floats, actions: Floats, seed: int) -> list[Floats]:
    """Return the arrays of `Networks` for one network that has learned float64[n, 9] -> float64[n, 30, 4].

    Errors are those of places, which accelerations lead to, and a little of the accelerations.
    """
    torch.manual_seed(seed)
    mean, scale = situations.mean(axis=0), situations.std(axis=0) + 1e-6
    middle, spread = actions.mean(axis=0).ravel(), np.tile(actions.std(axis=(0, 1)) + 1e-6, STEPS)
    given = torch.from_numpy((situations - mean) / scale).float()
    wanted = torch.from_numpy((actions.reshape(len(actions), -1) - middle) / spread).float()
    ahead = np.maximum(np.arange(STEPS)[:, None] - np.arange(STEPS) + 0.5, 0.0) * STEP * STEP
    way = torch.from_numpy(np.tril(ahead)).float()  # from accelerations to places
    sideways = np.maximum(situations[:, 0], SLOWEST) ** 2  # of a curvature [m/s2]
    units = torch.ones((len(situations), 1, ACTIONS))
    units[:, 0, 1] = torch.from_numpy(sideways).float()
    size = torch.from_numpy(spread).float()
    layers = [torch.nn.Linear(len(mean), WIDTH), torch.nn.Linear(WIDTH, WIDTH), torch.nn.Linear(WIDTH, STEPS * ACTIONS)]
    optimiser = Adam([parameter for layer in layers for parameter in layer.parameters()], lr=RATE)
    for update in range(UPDATES):
        rows = torch.randint(len(given), (BATCH,))
        within = torch.relu(layers[1](torch.relu(layers[0](given[rows]))))
        error = ((layers[2](within) - wanted[rows]) * size).view(-1, STEPS, ACTIONS) * units[rows]
        loss = torch.einsum("st,ntk->nsk", way, error).square().mean() + JERK * error.square().mean()
        for group in optimiser.param_groups:
            group["lr"] = RATE * 0.5 * (1.0 + np.cos(np.pi * update / UPDATES))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    (entry, entry_bias), inner, (out, out_bias) = (
        (layer.weight.detach().double().numpy().T, layer.bias.detach().double().numpy()) for layer in layers
    )
    entry = entry / scale[:, None]
    return [entry, entry_bias - mean @ entry, *inner, out * spread, out_bias * spread + middle]
