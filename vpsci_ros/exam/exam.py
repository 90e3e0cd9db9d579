"""What is asked: an exam's parameters, driving system, episodes and pedestrians, read and checked before any run."""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Key
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.drivers import Driver
from vpsci_ros.exam.process import OWN, command_of, files_of, files_of_class
from vpsci_ros.lockstep.engines import require_own
from vpsci_ros.lockstep.intervention import HeadStarts, Intervention
from vpsci_ros.lockstep.simulator_config import SimulatorConfig
from vpsci_ros.parameters import parameter
from vpsci_ros.policy.agent_types import AGENT_TYPES
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.policy_config import LEARNED, PolicyConfig
from vpsci_ros.policy.policy_file import Policy, load_policy
from vpsci_ros.resources import near_misses_path, weights_path
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.journal import claim
from vpsci_ros.runs.provenance import cpu_name, software_versions
from vpsci_ros.runs.run_config import PatienceConfig, RunConfig, Sections
from vpsci_ros.runs.workers import HERE, Site
from vpsci_ros.world import Scenario, WorldConfig, load_scenarios
from vpsci_ros.world.crowd import CrowdConfig
from vpsci_ros.world.drivers import PEDESTRIAN_DRIVERS
from vpsci_ros.world.perception import PerceptionConfig

if TYPE_CHECKING:
    import polars as pl

    from vpsci_ros.exam.recorded_people import Motion

EXAM = "exam.json"  # what an exam is, in its folder
ALONE = "alone"  # of an exam's runs the one on the empty road, the reference of the time lost
SEVERE_TTC = 1.0  # [s] a severe conflict is one with a CurvTTC below
MOVING = 0.5  # [m/s] a vehicle slower than this at the contact stood: the pedestrian walked into it
STANDS = 0.1  # [m/s] a vehicle slower than this stands
HARD_BRAKING = 3.5  # [m/s2] just above the 3.4 with which most drivers are comfortable (AASHTO, Geometric Design)
SILENT_TICKS = 20  # in a row without a usable command, after which an ADS has failed
SURPLUS_LIMIT = 100  # commands a tick beyond the first one; an ADS that sends more floods, and has failed
EXTERNAL = "external"  # an ADS that the user starts himself
PERSON = "you"  # a person drives (`vpsci drive`)
ADS, BASELINE = "ads", "autopilot"  # drivers of an exam: the system under test, and the autopilot beside it
DRIVERS = {LEARNED: "policy", "recorded": "replay", "walker": "autopilot"}
_RULES = [name for name in PEDESTRIAN_DRIVERS if name not in (*DRIVERS.values(), EXTERNAL)]
DRIVERS |= {name: name for name in _RULES}
"""Pedestrian -> the world's `pedestrian_driver`."""

TITLES = {
    LEARNED: "default pedestrian",
    "recorded": "recorded pedestrian",
    "walker": "walker, does not react",
    **{name: name.replace("_", " ") for name in _RULES},
    ALONE: "empty road",
}


def added_pedestrians() -> tuple[str, ...]:
    """Return the names of the agents that other installed Python packages add."""
    return tuple(name for name in AGENT_TYPES.names() if name != LEARNED)


def title_of(pedestrian: str) -> str:
    """Return a pedestrian's title in reports."""
    return TITLES.get(pedestrian, pedestrian)


OWN_TIMING, AUTOPILOTS_TIMING = "own", "autopilot"
TIMINGS = (OWN_TIMING, AUTOPILOTS_TIMING)
FAILURES = ("moving_collision", "collision", "conflict", "severe_conflict")
"""What counts as a failure: columns of the table of episodes."""


@dataclass(frozen=True)
class ExamConfig:
    """The exam of a driving system: the system, the pedestrians and the criteria."""

    ads: str = parameter("example_ads", "command that starts the driving system; external: you start it yourself")
    ads_class: str = parameter("", "MODULE:CLASS of a driving system in Python; replaces `ads`")
    pedestrians: list[str] = parameter(
        [name for name in DRIVERS if name != "recorded"],
        "pedestrians of the exam (docs/ads.md); also added agents (docs/extending.md)",
    )
    recorded: str = parameter(
        "", "near misses to replay as one more pedestrian: right_turns, right_turns/dev, or a Parquet file"
    )
    perception: bool = parameter(
        False, "true: pedestrians come on /perception/objects, with errors of perception, and not as odometry"
    )
    baseline: bool = parameter(True, "also drive the episodes with the rule-based autopilot, for comparison")
    fail_if: list[str] = parameter([], "criteria that fail the exam; --fail-if adds criteria to these")
    timing: str = parameter(
        OWN_TIMING,
        "own: pedestrians are timed to the system's drive on the empty road; autopilot: as drawn",
        choices=TIMINGS,
    )
    allow_standing: bool = parameter(False, "true: as --allow-standing")
    failure: str = parameter("moving_collision", "event that makes an episode a failure", choices=FAILURES)
    bags: bool = parameter(
        False, "also write bags of a system without ROS; the system then drives one episode at a time"
    )
    check_state: bool = parameter(
        True, "fail a class or a program behind a socket that keeps state from one episode to the next (docs/ads.md)"
    )

    def __post_init__(self) -> None:
        if not self.ads.strip():
            raise InvalidInput("ads is empty; give the command that starts the driving system, or 'external'")
        known = (*DRIVERS, *added_pedestrians())
        if unknown := [name for name in self.pedestrians if name not in known]:
            raise InvalidInput(f"pedestrians: unknown {unknown[0]!r}; expected {', '.join(known)}")
        if len(set(self.pedestrians)) < len(self.pedestrians):
            raise InvalidInput(f"pedestrians must be named once each, got {self.pedestrians}")
        if not self.pedestrians and not self.recorded:
            raise InvalidInput("pedestrians is empty; name at least one")
        if "recorded" in self.pedestrians and not self.recorded:
            raise InvalidInput(
                "pedestrians holds recorded, but no recordings are given; set 'recorded' to a near-miss table"
            )

    @property
    def examined(self) -> str:
        """The driving system: a command, or MODULE:CLASS."""
        return self.ads_class or self.ads

    @property
    def opponents(self) -> list[str]:
        """The names of the exam's pedestrians, in the order of `DRIVERS`, then those that other packages add."""
        names = {*self.pedestrians, *(["recorded"] if self.recorded else [])}
        return [name for name in (*DRIVERS, *added_pedestrians()) if name in names]


_CHECKED_AGAIN = ("fail_if", "failure", "allow_standing")  # parameters that may change when an exam is checked again
SIDE_BY_SIDE = 256  # episodes of a class
PART = 100  # episodes of a run, at most: where there are more, its pedestrian has several runs


@dataclass(frozen=True)
class Exam:
    """An exam: the driving system and its episodes; no file is read after `prepare`.

    :ivar sections: parameters of all nodes, by section.
    :ivar scenarios: those that `world_simulator.scenarios` names, in that order.
    :ivar default: weights or bank of the default pedestrian, from the file `weights`.
    :ivar people: the near misses whose pedestrians are replayed; None: none are.
    :ivar hashes: SHA-256 of the file of `default` ("weights"), and of `people` ("recorded", else "").
    :ivar files: name -> SHA-256 of each file of the driving system.
    :ivar digest: SHA-256 of its identity where it was prepared, see `sealed`.
    :ivar part: number of this part of an exam in several parts, from 0.
    :ivar driver: context manager that replaces the driver under test, in this process and one episode at a time; it
        gets the log and the patience for an answer [s]. None: the system of `config` drives.
    :ivar head_starts: see `HeadStarts`; they come from `exam.timing`.
    :ivar interventions: changes of the system's commands; none in an exam, which `ads-why` and `ads-protocol` change.
    :ivar motions: pedestrian -> motion that is given, of pedestrians other than `recorded`.
    """

    sections: Sections
    config: ExamConfig
    run: RunConfig
    world: WorldConfig
    scenarios: Sequence[Scenario]
    default: Policy
    weights: Path
    people: "pl.DataFrame | None"
    hashes: Mapping[str, str]
    files: Mapping[str, str] = dataclasses.field(default_factory=dict)
    digest: str = ""
    part: int = 0
    driver: Callable[[Path, float], AbstractContextManager[Callable[[], Driver]]] | None = None
    head_starts: HeadStarts = dataclasses.field(default_factory=dict)
    interventions: Mapping[Key, Intervention] = dataclasses.field(default_factory=dict)
    motions: "Mapping[str, Motion]" = dataclasses.field(default_factory=dict)

    @property
    def person(self) -> bool:
        """Whether a person drives; each run is then one episode, and there is no run on an empty road."""
        return self.config.ads == PERSON

    @property
    def in_process(self) -> bool:
        """Whether the exam simulates in its own process and calls the driver at each tick, without ROS."""
        return self.driver is not None or bool(self.config.ads_class)

    @property
    def simulator(self) -> SimulatorConfig:
        """Configuration of `world_simulator`, such as its engine."""
        return self.sections.get(SimulatorConfig, "world_simulator")

    @property
    def patience(self) -> float:
        """Time [s] for which the exam waits for an answer or for progress."""
        return self.sections.get(PatienceConfig, "graph").progress_timeout

    @property
    def opponents(self) -> list[str]:
        """The pedestrians of the runs, in order: first "alone" (an empty road) unless a person drives."""
        return [*([] if self.person else [ALONE]), *self.config.opponents]

    @property
    def episodes(self) -> list[Key]:
        """The (scenario, episode) numbers of the exam's episodes, the same with each pedestrian."""
        return list(self.run.queue())

    def only(self, keys: Sequence[Key]) -> "Exam":
        """Return the exam restricted to these episodes."""
        listed = [number for key in keys for number in key]
        sections = self.sections.changed("world_simulator", {"only": listed})
        return dataclasses.replace(self, sections=sections, run=dataclasses.replace(self.run, only=listed))

    def parts(self) -> list["Exam"]:
        """Return the exam split by episodes, each part with a run for each pedestrian, for any number of workers."""
        keys, most = self.episodes, 1 if self.person else SIDE_BY_SIDE if self.config.ads_class else PART
        if len(keys) <= most:
            return [self]
        starts = enumerate(range(0, len(keys), most))
        return [dataclasses.replace(self.only(keys[k : k + most]), part=n) for n, k in starts]

    @property
    def perception(self) -> PerceptionConfig | None:
        """Errors of the pedestrians' published data; None: the ADS gets exact odometry."""
        return self.sections.get(PerceptionConfig, "perception") if self.config.perception else None

    @property
    def latency(self) -> float | None:
        """Delay of the pedestrians' published data [s], in whole ticks; None: the ADS gets exact odometry."""
        return None if self.perception is None else self.perception.delay(self.world.tick) * self.world.tick

    def reach(self, pedestrian: str) -> NDArray[np.float64] | None:
        """Return a pedestrian's quantiles of recorded onsets, float64[4, 5], see `onset_range`; None without a bank."""
        known = pedestrian == LEARNED and isinstance(self.default, Bank)
        return self.default.of(self.policy(LEARNED).people).reach if known else None  # type: ignore[union-attr]

    def policy(self, pedestrian: str) -> PolicyConfig:
        """Return the parameters of a pedestrian that acts from the hand-over on, by weights or by an added agent."""
        return dataclasses.replace(self.sections.get(PolicyConfig, "pedestrian_policy"), agent=pedestrian)

    def with_pedestrian(self, pedestrian: str, vehicle: str) -> WorldConfig:
        """Return the world's configuration with one of the pedestrians and this driver of the vehicle."""
        driver = "policy" if pedestrian in added_pedestrians() else DRIVERS.get(pedestrian, "replay")
        world = dataclasses.replace(self.world, vehicle_driver=vehicle)
        if driver == "replay":  # of one person each
            world = dataclasses.replace(world, pedestrians=1, crowd=CrowdConfig())
        return dataclasses.replace(world, pedestrian_driver=driver)

    def motion(self, pedestrian: str) -> "Motion":
        """Return each episode's motion of a replayed pedestrian: given, recorded, or far away (empty road)."""
        from vpsci_ros.exam.recorded_people import absent_pedestrians, recorded_people

        if pedestrian in self.motions:
            return self.motions[pedestrian]
        if pedestrian == ALONE or self.people is None:
            return absent_pedestrians(self.spawns())
        path, world = self.config.recorded, self.with_pedestrian(pedestrian, "external")
        return recorded_people(self.people, self.spawns(), self.scenarios, world, self.run.seed, path, self.head_starts)

    def spawns(self) -> NDArray[np.void]:
        """Return the states at the spawns of the exam's n episodes with one pedestrian each, EPISODE[n]."""
        from vpsci_ros.exam.recorded_people import spawns

        return spawns(self.with_pedestrian(ALONE, "external"), self.scenarios, self.episodes, self.run.seed)


def prepare(sections: Sections, ads: str | None = None, ads_class: str | None = None, workers: Site = HERE) -> Exam:
    """Return the exam that the parameters describe, with all files that it needs, after all checks before a run.

    :param ads, ads_class: the driving system, instead of the one that the parameters name: a command, or MODULE:CLASS.
    :param workers: where the runs will be driven.
    :raises InvalidInput: a parameter, the command, the class, weights or recordings are refused.
    """
    from vpsci_ros.data.near_misses import read_near_misses  # parameter files are read without it

    if ads is not None and ads_class is not None:
        raise InvalidInput("--ads and --ads-class exclude each other: a driving system is a program or a class")
    given: dict[str, Any] = {"ads": ads, "ads_class": ""} if ads is not None else {}
    given |= {"ads_class": ads_class} if ads_class else {}
    chosen = sections.changed("ads_test", given).changed("world_simulator", {"batch": 1})
    if "weights" not in chosen.values.get("pedestrian_policy", {}):
        chosen = chosen.changed("pedestrian_policy", {"weights": "people"})
    config, simulator = chosen.get(ExamConfig, "ads_test"), chosen.get(SimulatorConfig, "world_simulator")
    run, world = chosen.get(RunConfig, "world_simulator"), chosen.get(WorldConfig, "world_simulator")
    if config.ads_class:
        require_lock_step(simulator)
    if config.ads_class or config.baseline:
        require_own(simulator.engine, "a class and the autopilot (ads_test.baseline) drive")
    if not workers.alone and config.examined == EXTERNAL:
        raise InvalidInput(
            "a system that you start yourself (external) drives in one graph only, on this machine; leave --workers "
            "and --cluster out"
        )
    if config.examined.strip() == OWN and world.pedestrians > 1 and not config.perception:
        raise InvalidInput(
            f"ads_test.ads = {OWN}: /pedestrian/odometry holds the first pedestrian only, and "
            f"world_simulator.pedestrians = {world.pedestrians}; set ads_test.perception to true, which lists all"
        )
    if config.recorded:
        require_own(simulator.engine, "recorded people are replayed")
    weights = weights_path(chosen.get(PolicyConfig, "pedestrian_policy").weights)
    scenarios = load_scenarios(run.scenarios, run.scenario_files)
    people = read_near_misses(config.recorded) if config.recorded else None
    recorded = sha256(near_misses_path(config.recorded)) if config.recorded else ""
    hashes, default = {"weights": sha256(weights), "recorded": recorded}, load_policy(weights)
    exam = Exam(chosen, config, run, world, scenarios, default, weights, people, hashes, driver_files(config))
    exam.reach(LEARNED)  # refuses a source of reactions that the bank does not have
    return sealed(exam)


def require_lock_step(simulator: SimulatorConfig) -> None:
    """Refuse the real-time mode for a system that is called at every tick: the world always waits for its answer.

    :raises InvalidInput: the world would not wait for it.
    """
    if simulator.external_mode != "lock_step":
        raise InvalidInput(
            "world_simulator.external_mode = real_time: a system that drives without ROS is called at every tick, "
            "however long it takes; examine it as a program that speaks ROS, by --ads"
        )


def driver_files(config: ExamConfig) -> dict[str, str]:
    """Return the files of the driving system, each with its SHA-256.

    :raises InvalidInput: there is no such program or class.
    """
    if config.ads_class:
        return files_of_class(config.ads_class)
    if config.ads == EXTERNAL:
        return {}
    command_of(config.ads)
    return files_of(config.ads)


def identity_of(exam: Exam) -> dict[str, Any]:
    """Return the identity of an exam; exams with equal identities can reuse each other's runs."""
    examined = {name: value for name, value in dataclasses.asdict(exam.config).items() if name not in _CHECKED_AGAIN}
    nodes = ("world_simulator", "safety_monitor", "pedestrian_policy", *(["perception"] if exam.perception else []))
    return {
        "ads": exam.config.examined,
        "seat": exam.driver is not None,
        "ads_files_sha256": dict(exam.files),
        "parameters": {name: dict(exam.sections.values.get(name, {})) for name in nodes} | {"ads_test": examined},
        "world": dataclasses.asdict(exam.world),
        "scenarios_sha256": {scenario.name: scenario.sha256 for scenario in exam.scenarios},
        "weights_sha256": exam.hashes["weights"],
        "agents": {name: AGENT_TYPES.origin(name) for name in exam.config.opponents if name in added_pedestrians()},
        "recorded_sha256": exam.hashes["recorded"],
        "software": software_versions(),
        "cpu": cpu_name(),
    }


def sealed(exam: Exam) -> Exam:
    """Return the exam with the SHA-256 of its present identity, which its runs have wherever they are driven."""
    text = json.dumps(identity_of(exam), sort_keys=True)
    return dataclasses.replace(exam, digest=hashlib.sha256(text.encode()).hexdigest())


def take_folder(folder: Path, identity: dict[str, Any], name: str = EXAM) -> None:
    """Store the exam's identity in a new folder, or check that the folder has an exam with the same identity.

    :param name: of the file that says what it is.
    :raises InvalidInput: it holds something else.
    """
    claim(folder / name, identity, "holds an exam")
