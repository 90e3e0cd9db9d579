"""What is examined, on which episodes, and what each of its runs begins from."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Key
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.exam.config import ALONE, DRIVERS, ExamConfig, added_pedestrians
from vpsci_ros.exam.driver_class import Driver
from vpsci_ros.exam.episode_list import flat
from vpsci_ros.exam.recorded_people import Motion, absent_pedestrians, recorded_people, spawns
from vpsci_ros.policy.config import PolicyConfig
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.config import RunConfig
from vpsci_ros.runs.sections import Sections
from vpsci_ros.world import Scenario, WorldConfig, load_scenarios
from vpsci_ros.world.crowd import CrowdConfig
from vpsci_ros.world.engines import EngineConfig
from vpsci_ros.world.perception import PerceptionConfig

SIDE_BY_SIDE = 256  # episodes of a class
PART = 100  # episodes of a run, at most: where there are more, its pedestrian has several runs


@dataclasses.dataclass(frozen=True)
class Exam:
    """What is examined, and on which episodes.

    :ivar sections: the parameters that the graphs are started with.
    :ivar part: which one of an exam in several parts, from 0.
    :ivar whole: that exam; None: it is whole itself.
    :ivar files: of the driving system, each with its SHA-256.
    :ivar seat: seats another driver at the wheel, in this process and one episode at a time, for as long as the context
        lasts; it gets the log and the patience for an answer [s]. None: the system of `config` drives.
    :ivar person: a person drives: an episode a run, and none with nobody there.
    :ivar motions: motion of pedestrians that the exam does not know, by their names.
    """

    sections: Sections
    config: ExamConfig
    run: RunConfig
    world: WorldConfig
    files: Mapping[str, str] = dataclasses.field(default_factory=dict)
    part: int = 0
    whole: "Exam | None" = None
    seat: Callable[[Path, float], AbstractContextManager[Callable[[], Driver]]] | None = None
    person: bool = False
    motions: Mapping[str, Callable[["Exam"], Motion]] = dataclasses.field(default_factory=dict)

    @property
    def in_process(self) -> bool:
        """Whether the system drives through the loop, without ROS."""
        return self.seat is not None or bool(self.config.ads_class)

    @property
    def engine(self) -> EngineConfig:
        """The engine that moves the agents."""
        return self.sections.get(EngineConfig, "world_simulator")

    @property
    def opponents(self) -> list[str]:
        """With whom it is driven, one after the other; first with nobody there, the reference of the time lost."""
        return [*([] if self.person else [ALONE]), *self.config.opponents]

    @property
    def episodes(self) -> list[Key]:
        """The episodes, the same ones with each pedestrian."""
        return list(self.run.queue())

    def only(self, keys: Sequence[Key]) -> "Exam":
        """Return the exam on these episodes alone."""
        listed = flat(keys)
        sections = self.sections.changed("world_simulator", {"only": listed})
        return dataclasses.replace(self, sections=sections, run=dataclasses.replace(self.run, only=listed))

    def parts(self) -> list["Exam"]:
        """Return the exam in parts that are driven in a run each, however many workers there are."""
        keys, most = self.episodes, 1 if self.person else SIDE_BY_SIDE if self.config.ads_class else PART
        if len(keys) <= most:
            return [self]
        starts = enumerate(range(0, len(keys), most))
        return [dataclasses.replace(self.only(keys[k : k + most]), part=n, whole=self.whole or self) for n, k in starts]

    @property
    def scenarios(self) -> list[Scenario]:
        """Where they take place."""
        return load_scenarios(self.run.scenarios, self.run.scenario_files)

    @property
    def perception(self) -> PerceptionConfig | None:
        """Errors of what is published of pedestrians to the ADS; None: it has their odometry."""
        return self.sections.get(PerceptionConfig, "perception") if self.config.perception else None

    @property
    def latency(self) -> float | None:
        """How late pedestrians are published to the ADS [s], in whole ticks; None: it has their odometry."""
        return None if self.perception is None else self.perception.delay(self.world.tick) * self.world.tick

    @property
    def weights(self) -> Path:
        """Weights of the learned pedestrian."""
        return weights_path(self.sections.get(PolicyConfig, "pedestrian_policy").weights)

    def policy(self, pedestrian: str) -> PolicyConfig:
        """Return the parameters of a pedestrian that acts from the hand-over on, learned or added."""
        return dataclasses.replace(self.sections.get(PolicyConfig, "pedestrian_policy"), agent=pedestrian)

    def with_pedestrian(self, pedestrian: str, vehicle: str) -> WorldConfig:
        """Return the world's configuration with one of the pedestrians and this driver of the vehicle."""
        driver = "policy" if pedestrian in added_pedestrians() else DRIVERS.get(pedestrian, "replay")
        world = dataclasses.replace(self.world, vehicle_driver=vehicle)
        if driver == "replay":  # of one person each
            world = dataclasses.replace(world, pedestrians=1, crowd=CrowdConfig())
        return dataclasses.replace(world, pedestrian_driver=driver)

    def motion(self, pedestrian: str) -> Motion:
        """Return the motion of a pedestrian that is replayed: recorded people, or nobody."""
        if pedestrian in self.motions:
            return self.motions[pedestrian](self)
        if pedestrian == ALONE:
            return absent_pedestrians(self.spawns())
        path, world = self.config.recorded, self.with_pedestrian(pedestrian, "external")
        begins = (self.whole or self).spawns()  # each person once before any twice, in whatever parts
        motion = recorded_people(read_near_misses(path), begins, self.scenarios, world, self.run.seed, path)
        return {key: motion[key] for key in self.episodes}

    def spawns(self, pedestrian: str = ALONE) -> NDArray[np.void]:
        """Return the episodes as they begin, EPISODE[n * P], P rows for each where there are several pedestrians."""
        return spawns(self.with_pedestrian(pedestrian, "external"), self.scenarios, self.episodes, self.run.seed)
