"""Parameters of the world: periods, hand-over, drivers, and how accelerations become motion."""

from dataclasses import dataclass, field

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import constant, parameter, table
from vpsci_ros.world.crowd import MOST, CrowdConfig
from vpsci_ros.world.drivers import PEDESTRIAN_DRIVERS, VEHICLE_DRIVERS
from vpsci_ros.world.kinds import KindMixture
from vpsci_ros.world.observation import STEP
from vpsci_ros.world.spawns import SPAWNS


@dataclass(frozen=True)
class WorldConfig:
    """The configuration of `vpsci_ros.world.World`; some defaults differ from section 3.2 of the paper.

    :raises InvalidInput: an unknown spawn or driver, a `tick` of which 0.1 s or `episode_time` is no multiple, more
        `crowd.sizes` than `pedestrians`, or several pedestrians with the driver replay.
    """

    tick: float = parameter(
        0.05, "simulated time from one tick to the next; policies act every 0.1 s", unit="s", low=0.005, high=STEP
    )
    episode_time: float = parameter(
        30.0, "simulated time after which an episode ends; the paper has 10 s", unit="s", low=0.1, high=3276.0
    )
    release_time: float = parameter(
        3.0, "time from the last critical tick to the hand-back", unit="s", low=0.0, high=60.0
    )
    spawn: str = parameter(
        "right_turns", "source of the initial motion of both agents (docs/world.md)", choices=tuple(SPAWNS)
    )
    vehicle_driver: str = parameter("policy", "driver of the vehicle (docs/world.md)", choices=tuple(VEHICLE_DRIVERS))
    pedestrian_driver: str = parameter(
        "policy", "driver of the pedestrian (docs/world.md)", choices=tuple(PEDESTRIAN_DRIVERS)
    )
    pedestrian_gain: float = parameter(
        1.0,
        "share of its policy's or its command's acceleration that the pedestrian executes; (21)-(24) have 0.5",
        low=0.0,
        high=1.0,
    )
    walk_on: bool = constant(
        True, "a pedestrian who has reached the goal walks on, out of the scene; false: it stands there"
    )
    proximity_distance: float = constant(
        4.0, "the autopilot brakes fully for a pedestrian this near ahead of its front", unit="m", low=0.0, high=50.0
    )
    lane_following: bool = parameter(
        True, "true: lane keeping is added to the lateral acceleration of the policy or driving system"
    )
    pedestrians: int = parameter(1, "largest number of pedestrians in an episode", low=1, high=MOST)
    crowd: CrowdConfig = field(default_factory=CrowdConfig)
    kinds: KindMixture = field(default_factory=KindMixture)

    def __post_init__(self) -> None:
        for row in table(WorldConfig):
            if row.choices:
                row.check(getattr(self, row.name), "world")
        for what, time in (("a policy's step", STEP), ("episode_time", self.episode_time)):
            ratio = time / self.tick
            if ratio < 0.999 or abs(ratio - round(ratio)) > 1e-6:
                raise InvalidInput(
                    f"{what} = {time} s must be a whole multiple of tick = {self.tick} s, got {ratio:g} ticks"
                )
        if len(self.crowd.sizes) > self.pedestrians:
            raise InvalidInput(
                f"crowd.sizes gives parts for up to {len(self.crowd.sizes)} pedestrians, but pedestrians = "
                f"{self.pedestrians}"
            )
        if self.pedestrians > 1 and self.pedestrian_driver == "replay":
            raise InvalidInput(
                "pedestrian_driver = replay has one recorded pedestrian an episode, but pedestrians = "
                f"{self.pedestrians}"
            )

    @property
    def policy_ticks(self) -> int:
        """Ticks from one policy frame to the next, which is 0.1 s later, as in recordings."""
        return round(STEP / self.tick)

    @property
    def episode_ticks(self) -> int:
        """Ticks after which an episode times out."""
        return round(self.episode_time / self.tick)

    @property
    def release_ticks(self) -> int:
        """Ticks after the last critical one in which the policies keep control."""
        return round(self.release_time / self.tick)
