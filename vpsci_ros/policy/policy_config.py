"""Parameters of policies: the shape of their networks, and their exploration.

Where the paper's Table 8 gives a value, it is the default.
"""

from dataclasses import dataclass

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import constant, parameter

SST = "sst"
ACTOR_HIDDEN, CRITIC_HIDDEN = (64, 64), (64, 64)  # two hidden layers of an actor, and of a critic after both branches
CRITIC_STATE, CRITIC_ACTION = 16, 16  # layers on a critic's encoded history, and on its joint action (all Table 8)
FADING = {"vehicle": 0.95, "pedestrian": 0.8}  # what goes on of the acceleration of the step before, see `actor`
LEARNED = "learned"  # the agent that acts by network weights or a bank


@dataclass(frozen=True)
class NetworkConfig:
    """The shape of the actors and critics (Table 8).

    :raises InvalidInput: a `hidden` that is no multiple of `heads`.
    """

    encoder: str = parameter(
        SST,
        "type of the networks' layers: sst, the paper's state-space Transformer, or another name that `vpsci study "
        "models` knows, such as transformer, lstm, feedforward",
    )
    hidden: int = parameter(64, "width of the layers of `encoder`; the paper has 256", low=8, high=1024)
    layers: int = parameter(1, "number of layers of `encoder`; the paper has 2", low=1, high=8)
    heads: int = constant(8, "attention heads", low=1, high=64)
    attention_window: int = constant(10, "steps that attention looks back over, this one included", low=1, high=64)
    action_limit: float = constant(
        5.0, "accelerations are clipped to plus and minus this, in training, too", unit="m/s2", low=0.1, high=50.0
    )

    def __post_init__(self) -> None:
        if self.hidden % self.heads:
            raise InvalidInput(f"hidden = {self.hidden}: expected a multiple of the {self.heads} attention heads")


@dataclass(frozen=True)
class NoiseConfig:
    """The exploration noise N(t) = N_0 exp(-beta t) + N_min (16)."""

    start: float = parameter(
        0.2, "initial amplitude N_0 of the noise (16)", unit="of the action limit", low=0.0, high=2.0
    )
    floor: float = constant(0.01, "N_min of (16)", unit="of the action limit", low=0.0, high=2.0)


@dataclass(frozen=True)
class PolicyConfig:
    """The policy of one agent: its weights or bank, and its exploration."""

    agent: str = parameter(LEARNED, "learned: acts by `weights`; or the name of an added agent (docs/extending.md)")
    weights: str = parameter(
        "",
        "bank or network weights: a safetensors file, or a shipped name (people, closed_loop, ma_sst_ddpg); empty: "
        "wait for weights on /policy/weights",
    )
    explore: bool = parameter(False, "add the exploration noise of equation (16) to the actions of a network")
    seed: int = parameter(1, "seed of the exploration noise and of the choice of reactions", low=0, high=2**63 - 1)
    people: str = parameter(
        "",
        "source in the bank whose reactions are replayed, such as cqut; empty: the bank's first source",
    )
    noise: NoiseConfig = NoiseConfig()
