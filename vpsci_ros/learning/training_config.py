"""Parameters of training, in groups; the defaults are those of the shipped weights `closed_loop`.

Stage 1 of these weights alone has another step size of the actors: `params/stage1_pretrain.yaml`.

The paper's Table 8 and section 3.2 give most of them; a description says where a value is ours.
"""

import math
from dataclasses import dataclass
from pathlib import Path

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import constant, parameter
from vpsci_ros.resources import weights_path
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.world_config import WorldConfig


@dataclass(frozen=True)
class LearnerConfig:
    """The learner: its stage, near misses, starting weights and output folder."""

    stage: str = parameter("pretrain", "pretrain: stage 1; refine: stage 2", choices=("pretrain", "refine"))
    near_misses: list[str] = parameter(
        [], "recorded near misses: right_turns, Parquet files, or parts (right_turns/dev); empty: right_turns/train"
    )
    output: str = parameter("out/learner", "folder of weights, log and checkpoints")
    seed: int = parameter(1, "seed of the initial weights and of sampling", low=0, high=2**63 - 1)
    weights: str = parameter(
        "", "weights from which stage 2 starts: a safetensors file, or the name of shipped weights"
    )

    def __post_init__(self) -> None:
        if self.stage == "pretrain" and self.weights:
            raise InvalidInput(f"weights = {self.weights}: stage 1 starts without weights; stage 2 starts from them")

    def start(self) -> Path:
        """Return the file of the weights that stage 2 starts from.

        :raises InvalidInput: there is no such file.
        """
        return weights_path(self.weights, made_by="vpsci pretrain")


@dataclass(frozen=True)
class ReplayConfig:
    """The size of a batch drawn from recorded near misses or from the replay buffer."""

    batch_size: int = parameter(256, "steps of experience in one update", low=1, high=65536)


@dataclass(frozen=True)
class UpdatesConfig:
    """The step sizes and other constants of the networks' updates."""

    actor_learning_rate: float = parameter(
        5e-4,
        "step size of the actors; with closed_loop it is halved after 500 updates, a third after 1,000",
        low=0.0,
        high=1.0,
    )
    critic_learning_rate: float = parameter(2e-4, "step size of the critics", low=0.0, high=1.0)
    discount: float = constant(0.99, "discount factor", low=0.0, high=1.0)
    target_update_rate: float = constant(0.01, "soft update rate of the target networks", low=0.0, high=1.0)
    importance_temperature: float = constant(
        100.0, "tau of (5), in units of the reward; the paper gives none", low=1e-3, high=1e9
    )
    critics: int = constant(1, "critics of an agent; the least of their targets counts", low=1, high=8)
    target_noise: float = constant(
        0.0, "standard deviation of the noise on target actions, cut off at twice that", unit="m/s2", low=0.0, high=5.0
    )


@dataclass(frozen=True)
class SpeedRewardsConfig:
    """The speed rewards (14) and (15) in stage 1."""

    speed_scaling: float = constant(100.0, "factor on the speed rewards (14) and (15)", low=0.0, high=1e6)
    least_speed_deviation: float = constant(
        0.9,
        "lower bound of the deviations in (14) and (15), ours: a turning car's sideways speed varies by 0.04 m/s only, "
        "which would drown all else; 0.001: none, as printed",
        unit="m/s",
        low=1e-3,
        high=10.0,
    )


@dataclass(frozen=True)
class ClosedLoopConfig:
    """The roll-outs of the objective closed_loop, in both stages; none of them is in the paper."""

    recorded: int = constant(64, "recorded steps from which an update rolls both actors out", low=1, high=4096)
    simulated: int = constant(80, "simulated steps from which it does, half of each kind of scenes", low=2, high=4096)
    imitated_steps: int = constant(25, "steps of a recorded roll-out", low=1, high=100)
    steps: int = constant(40, "steps of a simulated roll-out", low=1, high=200)
    beyond: int = constant(15, "steps after it in which the rule-based pair goes on", low=0, high=200)
    least_steps: int = constant(6, "steps that are recorded after a start, at least", low=1, high=100)
    before_onset: int = constant(5, "steps before the onset from which starts are drawn", low=0, high=10)
    speed_noise: float = constant(
        0.015, "deviation of the vehicle's speed at recorded starts, as a share", low=0, high=1
    )
    walking_noise: float = constant(0.03, "of the pedestrian's velocity", unit="m/s", low=0.0, high=2.0)
    place_noise: float = constant(0.075, "of the pedestrian's place", unit="m", low=0.0, high=2.0)
    acceleration_noise: float = constant(0.05, "of the accelerations before", unit="m/s2", low=0.0, high=2.0)
    limit: float = constant(
        0.275, "closed-loop error on training near misses up to which stage 2 may go", unit="m", low=0.0, high=10.0
    )
    weight: float = constant(8.0, "weight of that error at the start of stage 2", unit="1/m", low=0.0, high=100.0)
    most_weight: float = constant(60.0, "its greatest weight", unit="1/m", low=0.0, high=1e4)
    margin: float = constant(0.7, "least clearance that costs nothing", unit="m", low=0.0, high=10.0)
    margin_beyond: float = constant(0.2, "the same in the steps beyond", unit="m", low=0.0, high=10.0)
    contact: float = constant(6.0, "price of clearance below the margin", unit="1/m2", low=0.0, high=1e3)
    lane: float = constant(
        4.0, "price of the way beyond half a metre from the lane's middle", unit="1/m", low=0, high=1e3
    )
    late: float = constant(0.8, "price of the share of its speed that the pedestrian lacks at the end", low=0, high=1e3)
    effort: float = constant(0.003, "price of squared accelerations", unit="s4/m2", low=0.0, high=1e3)


@dataclass(frozen=True)
class PretrainConfig:
    """Stage 1: training on recorded near misses."""

    objective: str = parameter(
        "closed_loop",
        "objective of the actors: closed_loop, imitation of recorded near misses in closed loop; ddpg, Algorithm 1's "
        "policy gradient; or an added one (docs/extending.md)",
    )
    episodes: int = parameter(400, "training iterations, one mini-batch each", low=1, high=10_000_000)
    held_out_clips: list[str] = parameter(
        [],
        "clips held out of training: SOURCE/CLIP, or a beginning such as cqut-pvi/dev/; by default a fifth of the near "
        "misses, by whole clips; [none] holds out no clip",
    )
    evaluate_every: int = constant(100, "iterations from one held-out error to the next", low=1, high=1_000_000)
    checkpoint_every: int = constant(500, "iterations from one checkpoint to the next", low=1, high=1_000_000)
    replay: ReplayConfig = ReplayConfig()
    updates: UpdatesConfig = UpdatesConfig()
    rewards: SpeedRewardsConfig = SpeedRewardsConfig()
    closed_loop: ClosedLoopConfig = ClosedLoopConfig()


@dataclass(frozen=True)
class RewardsConfig:
    """The rewards of stage 2 (25)-(28).

    :raises InvalidInput: `weights` that are not three numbers with the sum 1.
    """

    collision: float = constant(-200.0, "C_collision of (25)", low=-1e6, high=0.0)
    goal: float = constant(100.0, "C_goal of (26)", low=0.0, high=1e6)
    speed_scaling: float = constant(100.0, "factor on the speed reward in simulation", low=0.0, high=1e6)
    weights: list[float] = constant(
        [], "fixed w_1 (collision), w_2 (goal), w_3 (speed) of (27); empty: adaptive by (28)", low=0.0, high=1.0
    )
    weight_temperature: float = constant(
        1e-5, "lambda of the adaptive weights (28); the paper gives none", low=0.0, high=10.0
    )

    def __post_init__(self) -> None:
        if self.weights and (len(self.weights) != 3 or not math.isclose(sum(self.weights), 1.0, abs_tol=0.011)):
            raise InvalidInput(f"rewards.weights must be three numbers that add up to 1 (or empty), got {self.weights}")


@dataclass(frozen=True)
class RefineConfig:
    """Stage 2: training in simulation (section 3.2)."""

    objective: str = parameter(
        "closed_loop",
        "objective of the actors: closed_loop, the gradient of the outcome through the kinematics, with imitation in "
        "closed loop as a constraint; ddpg, the critics' policy gradient; or an added one (docs/extending.md)",
    )
    refresh_every: int = parameter(20, "updates after which the acting policies get new weights", low=1, high=1_000_000)
    updates_per_episode: float = parameter(
        0.25, "updates for each episode in which the policies acted; Algorithm 1 has one", low=0.001, high=64.0
    )
    replay: ReplayConfig = ReplayConfig()
    updates: UpdatesConfig = UpdatesConfig(critics=2, target_noise=0.5)
    rewards: RewardsConfig = RewardsConfig()
    closed_loop: ClosedLoopConfig = ClosedLoopConfig()


def require_learnable(world: WorldConfig) -> None:
    """Refuse a world from which stage 2 cannot learn.

    :raises InvalidInput: a driver is not the policy; there are several pedestrians, or others than adults.
    """
    known: dict[str, str | int] = {f"{agent}_driver": "policy" for agent in AGENTS} | {"pedestrians": 1}
    for name, expected in known.items():
        if (got := getattr(world, name)) != expected:
            raise InvalidInput(f"world_simulator.{name} = {got}: stage 2 expects {expected}")
    if sum(world.kinds.parts) > world.kinds.adult:
        raise InvalidInput("world_simulator.kinds: stage 2 learns from adults, whom the policy moves at once")
