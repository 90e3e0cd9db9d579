"""The networks that may act, by name: what `network.encoder` chooses from, and the rows of `vpsci study models`.

All see the same observations, actions before and risk. Most differ in the layers of the encoder alone; three are
predictors of trajectories with a network of their own. How each learns is `learning`: see `LEARNING`.
"""

from dataclasses import dataclass, replace

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.actor import Actor
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.layers import BaselineLayer, FeedForwardLayer, LSTMLayer, TransformerLayer
from vpsci_ros.policy.planners import DenseTNT, MultiPath
from vpsci_ros.policy.social_lstm import SocialLSTM
from vpsci_ros.policy.sst import EncoderLayer, SSTEncoder, SSTLayer
from vpsci_ros.runs.plugins import PluginGroup

LEARNING = {
    "imitation": "recorded near misses: both agents rolled out together, or (together: False) the next velocity alone",
    "ddpg": "the policy gradient of critics that see both agents' actions",
    "single_agent_ddpg": "the policy gradient of critics that see their own agent's action alone",
    "prediction": "the loss of the network's own paper",
}


@dataclass(frozen=True)
class Model:
    """A network that may act, and how it learns.

    :ivar layer: class of the encoder's layers, the critics' too: `SSTLayer`, or one that derives from `BaselineLayer`.
    :ivar together: of imitation: both learn on their own predictions, rolled out; False: the next velocity alone.
    :ivar learning: of `LEARNING`.
    :ivar actor: class of the whole actor where it is no encoder with two hidden layers; it draws by a latent number.
    """

    layer: type[EncoderLayer]
    together: bool = False
    learning: str = "imitation"
    actor: type[Actor] | None = None

    def __post_init__(self) -> None:
        layer = self.layer
        if layer is not SSTLayer and not (isinstance(layer, type) and issubclass(layer, BaselineLayer)):
            raise InvalidInput(f"layer: expected SSTLayer, or a class that derives from BaselineLayer, got {layer!r}")
        if self.learning not in LEARNING:
            raise InvalidInput(f"learning: expected one of {', '.join(LEARNING)}, got {self.learning!r}")


MODELS = PluginGroup(
    "vpsci_ros.networks",
    "network",
    Model,
    {
        "ma_sst": Model(SSTLayer, together=True),
        "ma_transformer": Model(TransformerLayer, together=True),
        "ma_lstm": Model(LSTMLayer, together=True),
        "ma_feedforward": Model(FeedForwardLayer, together=True),
        "sst": Model(SSTLayer),
        "ma_sst_ddpg": Model(SSTLayer, learning="ddpg"),
        "ma_transformer_ddpg": Model(TransformerLayer, learning="ddpg"),
        "ma_ddpg": Model(FeedForwardLayer, learning="ddpg"),
        "transformer_ddpg": Model(TransformerLayer, learning="single_agent_ddpg"),
        "ddpg": Model(FeedForwardLayer, learning="single_agent_ddpg"),
        "densetnt": Model(LSTMLayer, learning="prediction", actor=DenseTNT),
        "multipath": Model(LSTMLayer, learning="prediction", actor=MultiPath),
        "social_lstm": Model(LSTMLayer, learning="prediction", actor=SocialLSTM),
        "transformer": Model(TransformerLayer),
        "lstm": Model(LSTMLayer),
        "feedforward": Model(FeedForwardLayer),
    },
)


def network_of(name: str, network: NetworkConfig) -> NetworkConfig:
    """Return `network` with the encoder of this name, and the latent number by which a predictor of its own draws.

    :raises InvalidInput: nothing has this name, or `network.carry_state` is false; other networks carry their state.
    """
    model = MODELS.find(name)
    if not network.carry_state:
        raise InvalidInput("carry_state: false; the models of this comparison carry their state: leave it true")
    encoder = "sst" if model.layer is SSTLayer else name
    return replace(network, encoder=encoder, latent=0 if model.actor is None else 1)


def make_actor(config: NetworkConfig) -> Actor:
    """Return an untrained actor of `config.encoder`.

    :raises InvalidInput: nothing has this name, or it cannot be as `config` says.
    """
    model = MODELS.find(config.encoder)
    if model.layer is not SSTLayer and not config.carry_state:
        raise InvalidInput(f"carry_state: false; encoder {config.encoder} carries its state: leave it true")
    if model.actor is not None:
        if config.latent != 1:
            raise InvalidInput(
                f"latent = {config.latent}: encoder {config.encoder} draws by one number; set latent = 1"
            )
        return model.actor(config)
    if model.layer is not SSTLayer and (config.latent or config.residuals):
        raise InvalidInput(f"encoder {config.encoder} is deterministic: set latent = 0 and residuals = false")
    return Actor(config, model.layer)


def tensor_shapes(config: NetworkConfig) -> tuple[dict[str, tuple[int, ...]], dict[str, tuple[int, ...]]]:
    """Return the tensors of an actor, and of the encoder of a critic, of `config.encoder`."""
    parts = make_actor(config), SSTEncoder(config, MODELS.find(config.encoder).layer)
    actor, encoder = ({name: tuple(value.shape) for name, value in part.state_dict().items()} for part in parts)
    return actor, encoder
