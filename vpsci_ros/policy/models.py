"""The networks by name, for `learner.encoder` and `vpsci study models`.

All networks get the same observations and earlier actions. They differ in the layers of the encoder, and in training.
"""

from dataclasses import dataclass

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.actor import Actor
from vpsci_ros.policy.policy_config import SST, NetworkConfig
from vpsci_ros.policy.sst import EncoderLayer, SSTEncoder, SSTLayer
from vpsci_ros.runs.plugins import PluginGroup


@dataclass(frozen=True)
class Model:
    """A network, and its training in `vpsci study models`.

    :ivar layer: class of the encoder's layers, the critics' too.
    :ivar learning: "supervised": the next velocity of recorded near misses; or the name of an objective.
    :raises InvalidInput: `layer` is no class that derives from `EncoderLayer`.
    """

    layer: type[EncoderLayer]
    learning: str = "supervised"

    def __post_init__(self) -> None:
        if not (isinstance(self.layer, type) and issubclass(self.layer, EncoderLayer)):
            raise InvalidInput(f"layer: expected a class that derives from EncoderLayer, got {self.layer!r}")


MODELS = PluginGroup("vpsci_ros.networks", "network", Model, {SST: Model(SSTLayer)})


def make_actor(config: NetworkConfig, fading: float = 0.0) -> Actor:
    """Return an untrained actor of `config.encoder`; `fading` as of `Actor`.

    :raises InvalidInput: no network has this name.
    """
    return Actor(config, fading, MODELS.find(config.encoder).layer)


def tensor_shapes(config: NetworkConfig) -> tuple[dict[str, tuple[int, ...]], dict[str, tuple[int, ...]]]:
    """Return the shapes of the tensors of an actor, and of a critic's encoder, by name.

    :raises InvalidInput: no network is called `config.encoder`.
    """
    parts = make_actor(config), SSTEncoder(config, MODELS.find(config.encoder).layer)
    actor, encoder = ({name: tuple(value.shape) for name, value in part.state_dict().items()} for part in parts)
    return actor, encoder
