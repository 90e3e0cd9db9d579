"""Parameters of the node `world_simulator` besides those of its world."""

from dataclasses import dataclass

from vpsci_ros.parameters import parameter


@dataclass(frozen=True)
class SimulatorConfig:
    """The node `world_simulator`: its engine, its pace, commands from outside, and what it publishes."""

    engine: str = parameter(
        "vpsci", "vpsci: own kinematics; carla or carla://HOST:PORT/MAP: a CARLA server (docs/carla.md)"
    )
    action_timeout: float = parameter(
        2.0,
        "wall time to wait for an answer; without an action the rule-based driver acts",
        unit="s",
        low=0.01,
        high=3600.0,
        read_only=False,
    )
    real_time_factor: float = parameter(
        0.0, "ratio of simulated time to wall time; 0: as fast as possible", low=0.0, high=1000.0, read_only=False
    )
    external_mode: str = parameter(
        "lock_step",
        "lock_step: wait for each command; real_time: hold the last command for 0.5 s, then brake",
        choices=("lock_step", "real_time"),
    )
    episode_changes: str = parameter(
        "", "JSON file that an exam writes: head starts and interventions (vpsci_ros.lockstep.intervention)"
    )
    recorded_bag: str = parameter(
        "", "bag that the driver replay follows, with the run's scenarios and episode numbers"
    )
