"""Parameters of policies: the shape of their networks, and how they explore.

Where the paper's Table 8 gives a value, it is the default.
"""

from dataclasses import dataclass

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import parameter

SST = "sst"
LEARNED = "learned"  # the agent that acts by weights
LOG_SCALE = (-4.0, 1.2)  # least and greatest logarithm of the scale of a policy's noise [m/s2]


@dataclass(frozen=True)
class NetworkConfig:
    """Shape of the actors and critics (Table 8)."""

    encoder: str = parameter(
        SST,
        "what stands in place of the paper's state-space Transformer: sst, or a name of `vpsci study models`, such as "
        "transformer, lstm, feedforward, multipath, densetnt, social_lstm; the last three draw, with latent 1",
    )
    hidden: int = parameter(256, "width of the SST state", low=8, high=1024)
    layers: int = parameter(2, "SST layers", low=1, high=8)
    heads: int = parameter(8, "attention heads", low=1, high=64)
    key_dimension: int = parameter(32, "keys and queries of one head; heads * key_dimension = hidden", low=1, high=256)
    attention_window: int = parameter(10, "steps that attention looks back over, this one included", low=1, high=64)
    carry_state: bool = parameter(
        True, "carry the SST state over the whole history; false: start it again in each attention window"
    )
    risk_input: bool = parameter(
        True, "CurvTTC's risk enters the networks with the observation, and does not only gate their attention"
    )
    tracked_steps: int = parameter(
        2,
        "closed loop of recorded near misses: starts from the velocity of the vehicle by its positions over so many "
        "observed steps, for published speeds lag behind; 0: from the recorded one",
        low=0,
        high=10,
    )
    latent: int = parameter(
        0,
        "latent numbers of each agent and episode, drawn at its start: what kind of person acts; a policy with some "
        "of them also adds autocorrelated noise to its actions; 0: a deterministic policy, as the paper's",
        low=0,
        high=64,
    )
    residuals: bool = parameter(
        False,
        "to what the networks do comes what a recorded person at a similar onset did beside them, drawn when the "
        "policies take over; objective energy_score, latent 0",
    )
    actor_hidden: list[int] = parameter([64, 64], "two hidden layers of the actor", low=1, high=1024)
    critic_state: int = parameter(16, "critic: layer on the encoded history", low=1, high=1024)
    critic_action: int = parameter(16, "critic: layer on the joint action", low=1, high=1024)
    critic_hidden: list[int] = parameter([64, 64], "critic: two hidden layers after both are joined", low=1, high=1024)
    action_limit: float = parameter(
        5.0, "accelerations are clipped to plus and minus this, in training, too", unit="m/s2", low=0.1, high=50.0
    )

    def __post_init__(self) -> None:
        if self.heads * self.key_dimension != self.hidden:
            raise InvalidInput(
                f"heads * key_dimension must equal hidden (values are the state's slices), "
                f"got {self.heads} * {self.key_dimension} and {self.hidden}"
            )
        if self.residuals and self.latent:
            raise InvalidInput(
                f"residuals of recorded people are the noise of networks without latent numbers, got latent = "
                f"{self.latent}; set latent = 0, or residuals = false"
            )
        for name in ("actor_hidden", "critic_hidden"):
            if len(getattr(self, name)) != 2:
                raise InvalidInput(f"{name} must give two widths, got {getattr(self, name)}")


@dataclass(frozen=True)
class NoiseConfig:
    """The exploration noise N(t) = N_0 exp(-beta t) + N_min (16)."""

    start: float = parameter(0.3, "N_0 of (16)", unit="of the action limit", low=0.0, high=2.0, read_only=False)
    decay: float = parameter(0.001, "beta of (16), per training episode", low=0.0, high=1.0, read_only=False)
    floor: float = parameter(0.05, "N_min of (16)", unit="of the action limit", low=0.0, high=2.0, read_only=False)


@dataclass(frozen=True)
class PolicyConfig:
    """One agent's learned policy."""

    agent: str = parameter(
        LEARNED, "who acts: learned, by the weights; or an agent that another distribution adds (docs/extending.md)"
    )
    weights: str = parameter(
        "", "bank of people or weights: a safetensors file, or people, ma_sst_ddpg; empty: wait for /policy/weights"
    )
    explore: bool = parameter(False, "add the exploration noise of equation (16)", read_only=False)
    seed: int = parameter(
        1, "seed of the exploration noise and of what a stochastic policy draws", low=0, high=2**63 - 1
    )
    people: str = parameter(
        "",
        "of a bank: whose reactions act, a source of its near misses up to a hyphen, such as cqut; empty: the first",
    )
    noise: NoiseConfig = NoiseConfig()
