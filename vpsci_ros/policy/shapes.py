"""Names and shapes of the tensors of a network configuration; for the SST, torch is not needed."""

import importlib
import itertools

from vpsci_ros.policy.policy_config import ACTOR_HIDDEN, CRITIC_ACTION, CRITIC_HIDDEN, CRITIC_STATE, SST, NetworkConfig
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS, OBSERVATION_SIZE

Shapes = dict[str, tuple[int, ...]]


def encoder_shapes(config: NetworkConfig) -> Shapes:
    """Return names and shapes of the tensors of one encoder with the layers of `config.encoder`."""
    if config.encoder != SST:
        return _built(config)[1]
    width = config.hidden
    shapes: Shapes = {
        "observation_mean": (OBSERVATION_SIZE,),
        "observation_scale": (OBSERVATION_SIZE,),
        "observation.weight": (width, OBSERVATION_SIZE),
        "observation.bias": (width,),
        "action.weight": (width, ACTION_SIZE),
    }
    for i in range(config.layers):
        layer: Shapes = dict.fromkeys(("decay_logit", "skip", "norm.weight", "norm.bias"), (width,))
        layer |= {f"{name}.weight": (width, width) for name in ("input", "query", "key", "attended", "readout")}
        layer["risk_gain"] = (config.heads,)
        shapes |= {f"layers.{i}.{name}": shape for name, shape in layer.items()}
    return shapes


def actor_shapes(config: NetworkConfig) -> Shapes:
    """Return names and shapes of the tensors of one actor."""
    if config.encoder != SST:
        return _built(config)[0]
    shapes = {"fading": (1,)} | {f"encoder.{name}": shape for name, shape in encoder_shapes(config).items()}
    return shapes | _dense("head", [config.hidden, *ACTOR_HIDDEN, ACTION_SIZE])


def critic_shapes(config: NetworkConfig) -> Shapes:
    """Return names and shapes of the tensors of one critic."""
    shapes = {f"encoder.{name}": shape for name, shape in encoder_shapes(config).items()}
    shapes |= {"state.weight": (CRITIC_STATE, config.hidden), "state.bias": (CRITIC_STATE,)}
    shapes |= {"action.weight": (CRITIC_ACTION, 2 * ACTION_SIZE), "action.bias": (CRITIC_ACTION,)}
    return shapes | _dense("head", [CRITIC_STATE + CRITIC_ACTION, *CRITIC_HIDDEN, 1])


def weight_shapes(config: NetworkConfig) -> Shapes:
    """Return names and shapes of all tensors of a weights file: both actors, both critics, and the speed statistics."""
    shapes: Shapes = {}
    for agent in AGENTS:
        shapes |= {f"{agent}_actor.{name}": shape for name, shape in actor_shapes(config).items()}
        shapes |= {f"{agent}_critic.{name}": shape for name, shape in critic_shapes(config).items()}
        shapes |= {f"{agent}_speed.mean": (2,), f"{agent}_speed.deviation": (2,)}
    return shapes


def _built(config: NetworkConfig) -> tuple[Shapes, Shapes]:
    """Return the shapes of the tensors of an actor and of an encoder, which torch builds for this."""
    built: tuple[Shapes, Shapes] = importlib.import_module("vpsci_ros.policy.models").tensor_shapes(config)
    return built


def _dense(name: str, widths: list[int]) -> Shapes:
    shapes: Shapes = {}
    for i, (before, after) in enumerate(itertools.pairwise(widths)):
        shapes |= {f"{name}.{2 * i}.weight": (after, before), f"{name}.{2 * i}.bias": (after,)}
    return shapes
