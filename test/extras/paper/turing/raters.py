"""Simulated raters: what they see of a clip is its realism with errors of their own, of the scene and of the moment."""

import numpy as np

from vpsci_ros.extras.paper.turing.answers import Answers


def simulated(
    rng: np.random.Generator,
    raters: int = 20,
    scenes: int = 8,
    effect: tuple[float, float, float] = (0.0, 0.0, -1.5),
    *,
    by_rater: float = 0.5,
    by_scene: float = 0.4,
    noise: float = 0.8,
) -> Answers:
    """Return answers whose true means of realism are 3 + `effect`, not rounded to whole points.

    :param by_rater, by_scene: deviations of the raters' and the scenes' own liking of each source; noise: the rest's.
    """
    shape = raters, scenes, 3
    liking = rng.normal(0.0, by_rater, (raters, 1, 3)) + rng.normal(0.0, by_scene, (1, scenes, 3))
    realism = 3.0 + np.array(effect) + liking + rng.normal(0.0, noise, shape)
    return Answers([f"rater {row}" for row in range(raters)], realism, realism > 3.0)
