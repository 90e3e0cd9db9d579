"""The models that `vpsci study models` compares: what their networks are, how they learn, and how they predict.

All see the same observations, actions and risk, have the same heads, and learn from the same near misses in the same
number of updates. They differ in the layers of the encoder, and in what they learn: agents rolled out together on their
own predictions through the kinematics (`imitation`; the paper's multi-agent rows), or the next velocity alone from
recorded histories (its supervised rows). The single-agent rows and the trajectory predictors of Table 9 are not here.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.predictors import Actions, PolicyPredictor, Predictor
from vpsci_ros.learning.config import PretrainConfig
from vpsci_ros.learning.imitation import TrajectoryImitation
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.sst import EncoderLayer, SSTLayer, StepState
from vpsci_ros.runs.plugins import PluginGroup
from vpsci_ros.studies.layers import BaselineLayer, FeedForwardLayer, LayerMemory, LSTMLayer, TransformerLayer
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS


@dataclass(frozen=True)
class Model:
    """A row of the comparison.

    :ivar layer: class of the encoder's layers: `SSTLayer`, or one that derives from `BaselineLayer`.
    :ivar together: both agents learn on their own predictions, rolled out; False: the next velocity alone.
    """

    layer: type[EncoderLayer]
    together: bool

    def __post_init__(self) -> None:
        layer = self.layer
        if layer is not SSTLayer and not (isinstance(layer, type) and issubclass(layer, BaselineLayer)):
            raise InvalidInput(f"layer: expected SSTLayer, or a class that derives from BaselineLayer, got {layer!r}")


MODELS = PluginGroup(
    "vpsci_ros.networks",
    "network",
    Model,
    {
        "ma_sst": Model(SSTLayer, together=True),
        "ma_transformer": Model(TransformerLayer, together=True),
        "ma_lstm": Model(LSTMLayer, together=True),
        "ma_feedforward": Model(FeedForwardLayer, together=True),
        "sst": Model(SSTLayer, together=False),
        "transformer": Model(TransformerLayer, together=False),
        "lstm": Model(LSTMLayer, together=False),
        "feedforward": Model(FeedForwardLayer, together=False),
    },
)


def untrained(model: Model, network: NetworkConfig, seed: int) -> Networks:
    """Return networks whose actors have the model's layers; targets start equal to them. Their critics stay unused.

    :raises InvalidInput: `network.carry_state` is false; the models carry theirs.
    """
    if not network.carry_state:
        raise InvalidInput("carry_state: false; the models of this comparison carry their state: leave it true")
    torch.manual_seed(seed)
    return Networks(network, model.layer)


def train(
    model: Model,
    interactions: Interactions,
    config: PretrainConfig,
    network: NetworkConfig,
    seed: int,
    report: Callable[[dict[str, float]], None] | None = None,
) -> Networks:
    """Train `model` as stage 1 by `closed_loop` trains its actors; what predicts is their running average (targets).

    :param report: called after every update with `episode`, `episodes` and the losses by name.
    """
    networks = untrained(model, network, seed)
    networks.set_statistics(*interactions.samples(), config.rewards.least_speed_deviation)
    if not model.together:
        config = replace(config, imitation=replace(config.imitation, rollout_steps=0))
    imitation = TrajectoryImitation(networks, interactions, config)
    rng = np.random.default_rng(seed)
    for episode in range(config.episodes):
        losses = imitation.update(rng, episode)
        networks.follow(config.updates.target_update_rate)
        if report is not None:
            report({"episode": episode + 1, "episodes": config.episodes} | losses)
    return networks


def predictor(model: Model, networks: Networks) -> Predictor:
    """Return how the trained `model` predicts; the SST by the same streaming code as the nodes."""
    if model.layer is SSTLayer:
        return PolicyPredictor(networks.weights({}, {}, actors="target_actor"))
    return LayerPredictor(networks)


class LayerPredictor:
    """Both target actors of networks with baseline layers, step by step in torch; see `Predictor`.

    A row's history is empty until the row is active for the first time; a row that has ended does not begin again.
    """

    def __init__(self, networks: Networks) -> None:
        self._networks = networks
        self.tracked_steps = networks.config.tracked_steps

    def begin(self, count: int) -> None:
        """See `Predictor.begin`."""
        self._memories = {agent: [_empty(layer, count) for layer in self._layers(agent)] for agent in AGENTS}
        self._before = {agent: torch.zeros(count, ACTION_SIZE) for agent in AGENTS}
        self._begun = torch.zeros(count, dtype=torch.bool)

    @torch.no_grad()
    def act(
        self,
        vehicle: NDArray[np.float32],
        pedestrian: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        active: NDArray[np.bool_],
    ) -> Actions:
        """See `Predictor.act`."""
        beginning = torch.from_numpy(active) & ~self._begun
        self._begun |= beginning
        answers = []
        for agent, observation in zip(AGENTS, (vehicle, pedestrian), strict=True):
            memories = self._memories[agent]
            for memory in memories:
                memory.clear(beginning)
            states: list[StepState] = list(memories)
            actor, seen = self._networks.target_actor[agent], torch.from_numpy(observation)
            answers.append(actor.step(seen, self._before[agent], torch.from_numpy(curvttc), states).numpy())
        return answers[0], answers[1]

    def executed(self, actions: Actions, active: NDArray[np.bool_]) -> None:
        """See `Predictor.executed`."""
        rows = torch.from_numpy(active)[:, None]
        for agent, action in zip(AGENTS, actions, strict=True):
            done: Tensor = torch.where(rows, torch.from_numpy(action), self._before[agent])
            self._before[agent] = done

    def _layers(self, agent: str) -> nn.ModuleList:
        return self._networks.target_actor[agent].encoder.layers


def _empty(layer: nn.Module, count: int) -> LayerMemory:
    assert isinstance(layer, BaselineLayer)
    return layer.empty(count)
