"""Episodes played in this process with the stand-in at the wheel, hundreds side by side."""

from collections.abc import Callable

import numpy as np

from vpsci_ros.data.episode import Key
from vpsci_ros.exam.conduct import Exam, loop_with
from vpsci_ros.exam.search.imitation import Imitation, Recent
from vpsci_ros.exam.search.margin import Floats, LeastMargins, Watched
from vpsci_ros.world.tick import Actions

_BATCH = 1024  # episodes side by side


def rehearse(
    exam: Exam, pedestrian: str, episodes: list[Key], driver: Imitation, watched: Watched, report: Callable[[int], None]
) -> Floats:
    """Return the least margin of each episode with the stand-in at the wheel, float64[n].

    :param report: called now and then with how many episodes have ended.
    """
    loop = loop_with(exam, pedestrian, "external", episodes, _BATCH)
    most = exam.world.pedestrians
    recent, least = Recent(most), LeastMargins(watched)
    with driver.at_the_wheel():
        while not loop.world.done:
            features, rows = recent.features(loop.world.now.state, loop.assessment.curvttc)
            answer = np.zeros((len(rows), 2))
            answer[:, 0] = driver.drive(features)
            step = loop.step(Actions(vehicle=np.repeat(answer, most, axis=0)))
            least.add(step.tick.state, step.assessment.curvttc)
            report(len(least.found))
    return np.array([least.found[key] for key in episodes])
