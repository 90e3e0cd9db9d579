"""Parameters of training, in groups that are small enough to read.

Where the paper's Table 8 and section 3.2 give a value, it is the default, except for `episodes` of stage 1 (600, which
is more than the objective closed_loop needs). params/paper_stage1.yaml and paper_stage2.yaml have all of the paper's.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.objectives import DESCRIPTION, find_objective, require_objective
from vpsci_ros.parameters import parameter
from vpsci_ros.world.config import WorldConfig
from vpsci_ros.world.observation import AGENTS


@dataclass(frozen=True)
class LearnerConfig:
    """What the learner does, from what, and where it writes."""

    stage: str = parameter("pretrain", "stage 1 or stage 2", choices=("pretrain", "refine"))
    near_misses: list[str] = parameter(
        [], "real near misses: right_turns, Parquet files, or parts (right_turns/dev); empty: right_turns/train"
    )
    output: str = parameter("out/learner", "folder for weights, log and checkpoints")
    seed: int = parameter(1, "seed of initial weights and sampling", low=0, high=2**63 - 1)


@dataclass(frozen=True)
class StartConfig:
    """What stage 2 starts from."""

    weights: str = parameter("", "safetensors file, or the name of weights shipped with the package")


# ---- both stages (Table 8)


@dataclass(frozen=True)
class ReplayConfig:
    """The replay buffer of stage 1."""

    batch_size: int = parameter(256, "steps of experience in one update, drawn as whole histories", low=1, high=65536)
    capacity: int = parameter(10000, "steps that the replay buffer holds", low=1, high=10_000_000)


@dataclass(frozen=True)
class UpdatesConfig:
    """Updates of the networks in stage 1."""

    critic_learning_rate: float = parameter(2e-4, "step size of the critics", low=0.0, high=1.0)
    discount: float = parameter(0.99, "discount factor", low=0.0, high=1.0)
    target_update_rate: float = parameter(0.01, "soft update rate of the target networks", low=0.0, high=1.0)
    gradient_clip: float = parameter(1.0, "gradients are scaled down to this norm", low=1e-6, high=1e9)
    value_unit: float = parameter(
        1.0,
        "rewards are divided by this before the critics learn them, so that values are of order one",
        low=1e-3,
        high=1e6,
    )
    importance_temperature: float = parameter(
        10.0, "tau of (5), in units of the reward; the paper gives none", low=1e-3, high=1e9
    )
    importance_limit: float = parameter(
        10.0,
        "upper bound of (5), relative to the batch's mean: its exponential would let one sample rule a batch; 0: none",
        low=0.0,
        high=1e9,
    )


# ---- stage 1


@dataclass(frozen=True)
class SpeedRewardsConfig:
    """The speed rewards (14) and (15) in stage 1."""

    speed_scaling: float = parameter(100.0, "factor on the speed rewards (14) and (15)", low=0.0, high=1e6)
    least_speed_deviation: float = parameter(
        0.3,
        "lower bound of the deviations in (14) and (15): a turning car's sideways speed varies by 0.02 m/s only, "
        "which would drown all else",
        unit="m/s",
        low=1e-3,
        high=10.0,
    )
    exploration: float = parameter(
        0.5, "standard deviation of the actions scored around the actor's", unit="m/s2", low=0.0, high=5.0
    )


@dataclass(frozen=True)
class DdpgConfig:
    """Objective ddpg in stage 1."""

    actor_learning_rate: float = parameter(1e-4, "step size of the actors", low=0.0, high=1.0)
    critic_head_start: int = parameter(
        300, "iterations of the critics alone before the actors follow them", low=0, high=10_000_000
    )


@dataclass(frozen=True)
class ImitationConfig:
    """Objectives closed_loop and energy_score in stage 1: recorded trajectories, rolled out."""

    learning_rate: float = parameter(1.5e-4, "peak step size of the actors", low=0.0, high=1.0)
    rollouts: int = parameter(32, "near misses rolled out in one update", low=1, high=4096)
    rollout_steps: int = parameter(
        15,
        "longest roll-out; 0: none, the actors learn the next velocity alone",
        unit="steps of 0.1 s",
        low=0,
        high=200,
    )
    dropout: float = parameter(0.3, "share of the encoded history that the actors' heads do without", low=0.0, high=0.9)
    mirror: bool = parameter(True, "mirror every other near miss left to right")


@dataclass(frozen=True)
class EnergyScoreConfig:
    """Objective energy_score in stage 1: the distribution of recorded trajectories."""

    samples: int = parameter(6, "roll-outs of each near miss, with other latent numbers and noise", low=2, high=256)


@dataclass(frozen=True)
class PretrainConfig:
    """Stage 1: learning from real near misses."""

    READ_BY: ClassVar[Mapping[str, Sequence[str]]] = {
        "imitation": ("closed_loop", "energy_score"),
        "energy_score": ("energy_score",),
        "ddpg": ("ddpg", "single_agent_ddpg"),
    }
    """Group that some of the built-in objectives read alone -> these."""

    objective: str = parameter("closed_loop", DESCRIPTION)
    episodes: int = parameter(600, "training iterations, one mini-batch each", low=1, high=10_000_000)
    held_out_fraction: float = parameter(
        0.2, "share of near misses, by whole clips, kept out of training", low=0.0, high=0.9
    )
    held_out_clips: list[str] = parameter(
        [],
        "clips kept out of training, as source/clip or how that begins, e.g. cqut-pvi/dev/; where the near misses hold "
        "none of them, the share is",
    )
    evaluate_every: int = parameter(100, "iterations from one held-out error to the next", low=1, high=1_000_000)
    checkpoint_every: int = parameter(500, "iterations from one checkpoint to the next", low=1, high=1_000_000)
    replay: ReplayConfig = ReplayConfig()
    updates: UpdatesConfig = UpdatesConfig()
    rewards: SpeedRewardsConfig = SpeedRewardsConfig()
    imitation: ImitationConfig = ImitationConfig()
    energy_score: EnergyScoreConfig = EnergyScoreConfig()
    ddpg: DdpgConfig = DdpgConfig()

    def __post_init__(self) -> None:
        require_objective(self.objective)


# ---- stage 2


@dataclass(frozen=True)
class OnlineReplayConfig(ReplayConfig):
    """The replay buffer of stage 2."""

    priority_exponent: float = parameter(0.6, "alpha of the sampling probabilities (17)", low=0.0, high=2.0)
    real_bonus: float = parameter(0.2, "beta of (17): extra priority of real experience", low=0.0, high=100.0)
    real_share: float = parameter(0.3, "share of the buffer that real experience keeps", low=0.0, high=0.9)


@dataclass(frozen=True)
class OnlineUpdatesConfig(UpdatesConfig):
    """Updates of the networks in stage 2."""

    critic_learning_rate: float = parameter(1e-4, "step size of the critics", low=0.0, high=1.0)
    value_unit: float = parameter(
        10.0,
        "rewards are divided by this before the critics learn them, so that values are of order one; objective ddpg "
        "converts the values of stage 1",
        low=1e-3,
        high=1e6,
    )
    steps_per_update: int = parameter(
        64,
        "new simulated steps that pay for one update; 0: one update for each episode, as Algorithm 1",
        low=0,
        high=1_000_000,
    )
    warm_up_steps: int = parameter(1000, "simulated steps before the first update", low=1, high=10_000_000)


@dataclass(frozen=True)
class ActorsConfig:
    """Step sizes of the actors in stage 2."""

    learning_rate: float = parameter(5e-5, "step size of the actors", low=0.0, high=1.0)
    learning_rate_decay: float = parameter(
        0.0, "the step size falls by this share with every episode, to a tenth at most", low=0.0, high=1.0
    )
    head_factor: float = parameter(
        1.0,
        "the actors' heads take larger steps by this: stage 1 has taught them decimetres per second squared, and "
        "emergencies take metres",
        low=0.0,
        high=1e3,
    )


@dataclass(frozen=True)
class RewardsConfig:
    """The rewards of stage 2 (25)-(28)."""

    collision: float = parameter(-200.0, "C_collision of (25)", low=-1e6, high=0.0)
    goal: float = parameter(100.0, "C_goal of (26)", low=0.0, high=1e6)
    speed_scaling: float = parameter(
        10.0, "factor on the speed reward, beside rewards of a hundred; 100 drowns them", low=0.0, high=1e6
    )
    exploration: float = parameter(
        0.5,
        "deviation of the actions that are scored around the actors' on real experience",
        unit="m/s2",
        low=0.0,
        high=5.0,
    )
    weights: list[float] = parameter(
        [], "fixed w_1 (collision), w_2 (goal), w_3 (speed) of (27); empty: adaptive by (28)", low=0.0, high=1.0
    )
    weight_temperature: float = parameter(1e-4, "lambda of the adaptive weights (28)", low=0.0, high=10.0)

    def __post_init__(self) -> None:
        if self.weights and (len(self.weights) != 3 or not math.isclose(sum(self.weights), 1.0, abs_tol=0.011)):
            raise InvalidInput(f"rewards.weights must be three numbers that add up to 1 (or empty), got {self.weights}")


@dataclass(frozen=True)
class ForesightConfig:
    """Objectives closed_loop and energy_score in stage 2: simulated seconds rolled out ahead."""

    rollouts: int = parameter(32, "moments of simulated experience rolled out in one update", low=1, high=4096)
    steps: int = parameter(40, "length of a roll-out", unit="steps of 0.1 s", low=1, high=200)
    hand_over_share: float = parameter(
        0.7, "share of roll-outs that begin at the hand-over; the others begin at any step after it", low=0.0, high=1.0
    )
    scale: list[float] = parameter(
        [180.0, 30.0, 1.0],
        "what the smooth collision and goal rewards and the speed reward are worth before their weights (27)",
        low=0.0,
        high=1e4,
    )
    clearance_ahead: float = parameter(
        0.0, "weight of the clearance that speeds of the moment lead to within 2 s", low=0.0, high=100.0
    )
    braking_share: float = parameter(
        0.0,
        "share of roll-outs in which the vehicle brakes to a stand whatever its policy says",
        low=0.0,
        high=1.0,
    )
    insisting_shares: list[float] = parameter(
        [0.0, 0.0],
        "shares of roll-outs in which the vehicle keeps its speed, and in which the pedestrian walks on, whatever "
        "their policies say",
        low=0.0,
        high=1.0,
    )

    def __post_init__(self) -> None:
        if len(self.scale) != 3:
            raise InvalidInput(f"foresight.scale must be three numbers, got {self.scale}")
        if len(self.insisting_shares) != 2 or self.braking_share + sum(self.insisting_shares) > 1.0:
            raise InvalidInput(
                f"foresight.insisting_shares must be two numbers that add up to 1 at most together with braking_share "
                f"= {self.braking_share:g}, got {self.insisting_shares}"
            )


@dataclass(frozen=True)
class OnlineDdpgConfig:
    """Objective ddpg in stage 2."""

    critic_warm_up: int = parameter(200, "updates of the critics alone before the actors follow", low=0, high=1_000_000)


@dataclass(frozen=True)
class RehearsalConfig:
    """Real near misses rolled out again in stage 2, as stage 1 did by the configuration that the weights carry."""

    weight: float = parameter(
        0.2,
        "weight of their gradient beside the policy gradient (objective closed_loop: of their clipped gradient, beside "
        "that of the simulated seconds); 0: as the paper",
        low=0.0,
        high=1e3,
    )
    rollouts: int = parameter(8, "near misses rolled out for that in one update", low=1, high=4096)


@dataclass(frozen=True)
class RefreshConfig:
    """What stage 2 gives the policies to act by, and keeps in the end."""

    updates: int = parameter(50, "updates between two refreshes of the policies", low=1, high=1_000_000)
    rollback_margin: float = parameter(
        0.1,
        "a refresh whose held-out closed-loop ADE exceeds stage 1's by this share is rolled back",
        low=0.0,
        high=1e9,
    )
    held_out_fraction: float = parameter(
        0.2, "share of near misses, by whole clips, for the held-out check; take that of stage 1", low=0.0, high=0.9
    )
    stage_1_share: float = parameter(
        0.0,
        "how far the actors that are kept lie on the way back to stage 1's; 0: what stage 2 has learned, as it is",
        low=0.0,
        high=1.0,
    )


@dataclass(frozen=True)
class ConvergenceConfig:
    """When stage 2 has converged (section 4.1)."""

    gradient_tolerance: float = parameter(
        1e-4, "converged where the policy gradient's norm stays below", low=0.0, high=1.0
    )
    episodes: int = parameter(100, "for so many episodes in a row", low=1, high=1_000_000)


@dataclass(frozen=True)
class RefineConfig:
    """Stage 2: learning on in simulation (section 3.2)."""

    READ_BY: ClassVar[Mapping[str, Sequence[str]]] = {
        "foresight": ("closed_loop", "energy_score"),
        "ddpg": ("ddpg", "single_agent_ddpg"),
    }
    """Group that some of the built-in objectives read alone -> these."""

    objective: str = parameter("closed_loop", DESCRIPTION)
    replay: OnlineReplayConfig = OnlineReplayConfig()
    updates: OnlineUpdatesConfig = OnlineUpdatesConfig()
    actors: ActorsConfig = ActorsConfig()
    rewards: RewardsConfig = RewardsConfig()
    foresight: ForesightConfig = ForesightConfig()
    ddpg: OnlineDdpgConfig = OnlineDdpgConfig()
    rehearsal: RehearsalConfig = RehearsalConfig()
    refresh: RefreshConfig = RefreshConfig()
    convergence: ConvergenceConfig = ConvergenceConfig()

    def __post_init__(self) -> None:
        require_objective(self.objective)

    def require_known_world(self, world: WorldConfig) -> None:
        """Refuse a world in which a policy does not act, or that moves otherwise than the differentiable copy of it.

        :raises InvalidInput: a driver is not the policy; there are several pedestrians, or others than adults, whom the
            policy does not always move; or what transitions do not hold (`pedestrian_gain`,
            `lane_following`, `policy_period`) is not as the objective takes for granted.
        """
        known: dict[str, str | float] = {f"{agent}_driver": "policy" for agent in AGENTS} | {"pedestrians": 1}
        known |= find_objective(self.objective).known_world
        for name, expected in known.items():
            if (got := getattr(world, name)) != expected:
                general = name.endswith("_driver") or name == "pedestrians"
                hint = "" if general else ", since transitions do not hold it; set it so, or choose ddpg"
                raise InvalidInput(
                    f"world_simulator.{name} = {_text(got)}: stage 2 with learner.objective {self.objective} "
                    f"expects {_text(expected)}{hint}"
                )
        if sum(world.kinds.parts) > world.kinds.adult:
            raise InvalidInput("world_simulator.kinds: stage 2 learns from adults, whom the policy moves at once")


def _text(value: str | float) -> str:
    return f"{value:g}" if type(value) is float else str(value)
