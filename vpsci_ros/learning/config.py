"""Parameters of networks and training.

Where the paper's Table 8 and section 3.2 give a value, it is the default, except for `episodes` of stage 1 (600, which
is more than the objective closed_loop needs). params/paper_stage1.yaml and paper_stage2.yaml have all of the paper's.
"""

import math
from dataclasses import dataclass

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import parameter
from vpsci_ros.world.config import WorldConfig

OBSERVATION_SIZE = 6
ACTION_SIZE = 2
AGENTS = ("vehicle", "pedestrian")
STEP = 0.1  # [s] of policies and of the real data
PEDESTRIAN_GAIN = WorldConfig().pedestrian_gain  # that the differentiable copy of the world has, (21)-(24)
RISK_TTC = 5.0  # [s] CurvTTC below which attention is gated towards a step


@dataclass(frozen=True)
class NetworkConfig:
    """Shape of the SST actors and critics (Table 8)."""

    hidden: int = parameter(256, "width of the SST state", low=8, high=1024)
    layers: int = parameter(2, "SST layers", low=1, high=8)
    heads: int = parameter(8, "attention heads", low=1, high=64)
    key_dimension: int = parameter(32, "keys and queries of one head; heads * key_dimension = hidden", low=1, high=256)
    attention_window: int = parameter(10, "steps that attention looks back over, this one included", low=1, high=64)
    carry_state: bool = parameter(
        True, "carry the SST state over the whole history; false: start it anew in each attention window"
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
        for name in ("actor_hidden", "critic_hidden"):
            if len(getattr(self, name)) != 2:
                raise InvalidInput(f"{name} must give two widths, got {getattr(self, name)}")


@dataclass(frozen=True)
class TrainingConfig:
    """What both stages of learning share (Table 8)."""

    batch_size: int = parameter(256, "steps of experience in one update, drawn as whole histories", low=1, high=65536)
    buffer_capacity: int = parameter(10000, "steps that the replay buffer holds", low=1, high=10_000_000)
    discount: float = parameter(0.99, "discount factor", low=0.0, high=1.0)
    target_update_rate: float = parameter(0.01, "soft update rate of the target networks", low=0.0, high=1.0)
    reward_scaling: float = parameter(100.0, "factor on the speed rewards (14) and (15)", low=0.0, high=1e6)
    least_speed_deviation: float = parameter(
        0.3,
        "lower bound of the deviations in (14) and (15): a turning car's sideways speed varies by 0.02 m/s only, "
        "which would drown all else",
        unit="m/s",
        low=1e-3,
        high=10.0,
    )
    importance_temperature: float = parameter(
        10.0, "temperature of the importance weights (5), in units of the temporal-difference error", low=1e-3, high=1e9
    )
    gradient_clip: float = parameter(1.0, "gradients are scaled down to this norm", low=1e-6, high=1e9)


@dataclass(frozen=True)
class PretrainConfig(TrainingConfig):
    """Stage 1: learning from real near misses."""

    objective: str = parameter(
        "closed_loop",
        "ddpg: Algorithm 1 of the paper; closed_loop: imitation of trajectories through the kinematics, critics by TD",
        choices=("closed_loop", "ddpg"),
    )
    episodes: int = parameter(600, "training iterations, one mini-batch each", low=1, high=10_000_000)
    actor_learning_rate: float = parameter(1e-4, "step size of the actors, objective ddpg", low=0.0, high=1.0)
    critic_learning_rate: float = parameter(2e-4, "step size of the critics", low=0.0, high=1.0)
    critic_head_start: int = parameter(
        300, "objective ddpg: iterations of the critics alone before the actors follow them", low=0, high=10_000_000
    )
    exploration: float = parameter(
        0.5,
        "objective ddpg: standard deviation of the actions scored around the actor's",
        unit="m/s2",
        low=0.0,
        high=5.0,
    )
    imitation_learning_rate: float = parameter(
        1.5e-4, "peak step size of the actors, objective closed_loop", low=0.0, high=1.0
    )
    imitation_head_factor: float = parameter(
        10.0,
        "objective closed_loop: the actors' heads take larger steps by this; they begin near zero",
        low=0.01,
        high=1e3,
    )
    velocity_weight: float = parameter(
        10.0,
        "objective closed_loop: weight of the next velocity's error against the positions'",
        unit="s",
        low=0.0,
        high=1e3,
    )
    rollouts: int = parameter(32, "objective closed_loop: near misses rolled out in one update", low=1, high=4096)
    rollout_steps: int = parameter(
        15,
        "objective closed_loop: longest roll-out; 0: none, the actors learn the next velocity alone",
        unit="steps of 0.1 s",
        low=0,
        high=200,
    )
    weight_decay: float = parameter(
        0.05, "decoupled weight decay of the actors, objective closed_loop", low=0.0, high=10.0
    )
    dropout: float = parameter(
        0.3, "objective closed_loop: share of the encoded history that the actors' heads do without", low=0.0, high=0.9
    )
    mirror: bool = parameter(True, "mirror every other near miss left to right")
    held_out_fraction: float = parameter(
        0.2, "share of near misses, by whole clips, kept out of training", low=0.0, high=0.9
    )
    evaluate_every: int = parameter(100, "iterations from one held-out error to the next", low=1, high=1_000_000)
    checkpoint_every: int = parameter(500, "iterations from one checkpoint to the next", low=1, high=1_000_000)


@dataclass(frozen=True)
class RefineConfig(TrainingConfig):
    """Stage 2: learning on in simulation (section 3.2)."""

    online_objective: str = parameter(
        "closed_loop",
        "ddpg: the critics' policy gradient, as the paper; closed_loop: rewards (25)-(27) made smooth and followed "
        "through the known kinematics, critics by TD",
        choices=("closed_loop", "ddpg"),
    )
    online_learning_rate: float = parameter(5e-5, "step size of the actors in stage 2", low=0.0, high=1.0)
    online_critic_learning_rate: float = parameter(1e-4, "step size of the critics in stage 2", low=0.0, high=1.0)
    learning_rate_decay: float = parameter(
        0.0, "the actors' step size falls by this share with every episode, to a tenth at most", low=0.0, high=1.0
    )
    head_factor: float = parameter(
        1.0,
        "the actors' heads take larger steps by this: stage 1 has taught them decimetres per second squared, and "
        "emergencies take metres",
        low=0.0,
        high=1e3,
    )
    foresight_rollouts: int = parameter(
        32, "objective closed_loop: moments of simulated experience rolled out in one update", low=1, high=4096
    )
    foresight_steps: int = parameter(
        40, "objective closed_loop: length of a roll-out", unit="steps of 0.1 s", low=1, high=200
    )
    foresight_scale: list[float] = parameter(
        [180.0, 30.0, 1.0],
        "objective closed_loop: what the smooth collision and goal rewards and the speed reward are worth before their "
        "weights (27)",
        low=0.0,
        high=1e4,
    )
    clearance_margin: float = parameter(
        0.5, "objective closed_loop: clearance that the agents should keep", unit="m", low=0.01, high=10.0
    )
    clearance_ahead: float = parameter(
        0.0,
        "objective closed_loop: weight of the clearance that speeds of the moment lead to within 2 s",
        low=0.0,
        high=100.0,
    )
    pace_weights: list[float] = parameter(
        [0.5, 0.5],
        "objective closed_loop: weights of the vehicle's and of the pedestrian's velocity in the goal reward",
        low=0.0,
        high=100.0,
    )
    haste_weight: float = parameter(
        1.0,
        "objective closed_loop: what being faster than at the hand-over costs in the goal reward, against being slower "
        "by as much",
        low=1.0,
        high=100.0,
    )
    braking_share: float = parameter(
        0.0,
        "objective closed_loop: share of roll-outs in which the vehicle brakes to a stand whatever its policy says",
        low=0.0,
        high=1.0,
    )
    insisting_shares: list[float] = parameter(
        [0.0, 0.0],
        "objective closed_loop: shares of roll-outs in which the vehicle keeps its speed, and in which the pedestrian "
        "walks on, whatever their policies say",
        low=0.0,
        high=1.0,
    )
    noise_start: float = parameter(
        0.3, "N_0 of the exploration noise (16)", unit="of the action limit", low=0.0, high=2.0
    )
    noise_decay: float = parameter(0.001, "beta of (16), per training episode", low=0.0, high=1.0)
    noise_floor: float = parameter(0.05, "N_min of (16)", unit="of the action limit", low=0.0, high=2.0)
    real_exploration: float = parameter(
        0.5,
        "deviation of the actions that are scored around the actors' on real experience",
        unit="m/s2",
        low=0.0,
        high=5.0,
    )
    priority_exponent: float = parameter(0.6, "alpha of the sampling probabilities (17)", low=0.0, high=2.0)
    real_bonus: float = parameter(0.2, "beta of (17): extra priority of real experience", low=0.0, high=100.0)
    rehearsal_weight: float = parameter(
        0.2,
        "weight of real near misses rolled out in closed loop, beside the policy gradient (objective closed_loop: of "
        "their clipped gradient, beside that of the simulated seconds); 0: as the paper",
        low=0.0,
        high=1e3,
    )
    rehearsal_rollouts: int = parameter(8, "near misses rolled out for that in one update", low=1, high=4096)
    real_capacity: float = parameter(0.3, "share of the buffer that real experience keeps", low=0.0, high=0.9)
    online_reward_scaling: float = parameter(
        10.0, "factor on the speed reward in stage 2, beside rewards of a hundred; 100 drowns them", low=0.0, high=1e6
    )
    collision_reward: float = parameter(-200.0, "C_collision of (25)", low=-1e6, high=0.0)
    goal_reward: float = parameter(100.0, "C_goal of (26)", low=0.0, high=1e6)
    reward_weights: list[float] = parameter(
        [], "fixed w_1 (collision), w_2 (goal), w_3 (speed) of (27); empty: adaptive by (28)", low=0.0, high=1.0
    )
    weight_temperature: float = parameter(1e-4, "lambda of the adaptive weights (28)", low=0.0, high=10.0)
    value_unit: float = parameter(
        10.0,
        "rewards are divided by this before the critics learn them, so that values are of order one",
        low=1e-3,
        high=1e6,
    )
    updates_per_refresh: int = parameter(50, "updates between two refreshes of the policies", low=1, high=1_000_000)
    steps_per_update: int = parameter(64, "new simulated steps that pay for one update", low=1, high=1_000_000)
    warm_up_steps: int = parameter(1000, "simulated steps before the first update", low=1, high=10_000_000)
    critic_warm_up: int = parameter(200, "updates of the critics alone before the actors follow", low=0, high=1_000_000)
    rollback_margin: float = parameter(
        0.1,
        "a refresh whose held-out closed-loop ADE exceeds stage 1's by this share is rolled back",
        low=0.0,
        high=10.0,
    )
    stage_1_share: float = parameter(
        0.0,
        "how far the actors that are kept lie on the way back to stage 1's; 0: what stage 2 has learned, as it is",
        low=0.0,
        high=1.0,
    )
    refine_held_out_fraction: float = parameter(
        0.2, "share of near misses, by whole clips, for the held-out check; take that of stage 1", low=0.0, high=0.9
    )
    gradient_tolerance: float = parameter(
        1e-4, "converged where the policy gradient's norm stays below", low=0.0, high=1.0
    )
    converged_episodes: int = parameter(100, "for so many episodes in a row", low=1, high=1_000_000)

    def __post_init__(self) -> None:
        if len(self.foresight_scale) != 3:
            raise InvalidInput(f"foresight_scale must be three numbers, got {self.foresight_scale}")
        if len(self.pace_weights) != 2:
            raise InvalidInput(f"pace_weights must be two numbers, got {self.pace_weights}")
        shares = self.insisting_shares
        if len(shares) != 2 or self.braking_share + sum(shares) > 1.0:
            raise InvalidInput(
                f"insisting_shares must be two numbers that add up to 1 at most together with braking_share = "
                f"{self.braking_share:g}, got {shares}"
            )
        weights = self.reward_weights
        if weights and (len(weights) != 3 or not math.isclose(sum(weights), 1.0, abs_tol=0.011)):
            raise InvalidInput(f"reward_weights must be three numbers that add up to 1 (or empty), got {weights}")

    def require_known_world(self, world: WorldConfig) -> None:
        """Refuse a world in which a policy does not act, or that moves otherwise than the differentiable copy of it.

        :raises InvalidInput: a driver is not the policy; or, for the objective closed_loop, what transitions do not
            tell (`pedestrian_gain`, `lane_following`, `policy_period`) is not as the copy takes for granted.
        """
        known: dict[str, str | float] = {f"{agent}_driver": "policy" for agent in AGENTS}
        if self.online_objective == "closed_loop":
            known |= {"pedestrian_gain": PEDESTRIAN_GAIN, "lane_following": True, "policy_period": STEP}
        for name, expected in known.items():
            if (got := getattr(world, name)) != expected:
                hint = (
                    "" if name.endswith("_driver") else ", since transitions do not tell it; leave it, or choose ddpg"
                )
                raise InvalidInput(
                    f"world_simulator.{name} = {_text(got)}: stage 2 with online_objective {self.online_objective} "
                    f"expects {_text(expected)}{hint}"
                )


def _text(value: str | float) -> str:
    return f"{value:g}" if type(value) is float else str(value)
