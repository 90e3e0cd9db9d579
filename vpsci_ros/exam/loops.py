"""The loop in which a driver meets one of an exam's pedestrians in this process, and the autopilot driving in it."""

import numpy as np

from vpsci_ros.data.episode import Key
from vpsci_ros.exam.collect import episodes_of
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.measures import RunResult
from vpsci_ros.exam.report import BASELINE, Conduct
from vpsci_ros.exam.sight import Watcher
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.world import Recorded, World
from vpsci_ros.world.intervention import InterventionConfig, Interventions
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.monitor import MonitorConfig

_BATCH = 64  # episodes side by side, of the autopilot


def loop_with(exam: Exam, pedestrian: str, vehicle: str, episodes: list[Key], batch: int) -> Loop:
    """Return the loop in which a driver of the world's meets a pedestrian in this process.

    :param vehicle: the world's `vehicle_driver`.
    :param batch: episodes side by side, at most.
    """
    config = exam.with_pedestrian(pedestrian, vehicle)
    recorded = None
    if config.pedestrian_driver == "replay":
        motion = exam.motion(pedestrian)
        recorded = Recorded({key: (np.zeros((len(rows), 5)), rows) for key, rows in motion.items()})
    agents = {}
    if config.pedestrian_driver == "policy":
        agents["pedestrian"] = agent = make_agent("pedestrian", exam.policy(pedestrian))
        if isinstance(agent, PolicyAgent):
            agent.load(load_policy(exam.weights), version=1)
    world = World(config, exam.scenarios, episodes, min(batch, len(episodes)), exam.run.seed, recorded)
    monitor = exam.sections.get(MonitorConfig, "safety_monitor")
    changes = exam.sections.get(InterventionConfig, "world_simulator")
    interventions = Interventions(changes, exam.scenarios, lane_following=config.lane_following)
    return Loop(world, monitor, agents, interventions=interventions if vehicle == "external" else None)


def autopilot_run(exam: Exam, pedestrian: str) -> RunResult:
    """Return the result of the rule-based autopilot with one pedestrian, many episodes side by side."""
    steps = loop_with(exam, pedestrian, "autopilot", exam.episodes, _BATCH)
    ticks = ((step.tick.state, step.assessment.curvttc, step.assessment.distance) for step in steps)
    found, sight = episodes_of(exam, ticks, Watcher(exam.scenarios), BASELINE)
    return RunResult(found, Conduct(len(exam.episodes)), sight=sight)
