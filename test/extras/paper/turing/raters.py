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
    skill: float | np.ndarray = 0.0,
) -> Answers:
    """Return answers whose true means of realism are 3 + `effect`, not rounded to whole points.

    :param by_rater, by_scene: deviations of the raters' and the scenes' own liking of each source; noise: the rest's.
    :param skill: d' of each rater against generated clips; against the control it is one more.
    """
    shape = raters, scenes, 3
    liking = rng.normal(0.0, by_rater, (raters, 1, 3)) + rng.normal(0.0, by_scene, (1, scenes, 3))
    realism = 3.0 + np.array(effect) + liking + rng.normal(0.0, noise, shape)
    seen = rng.normal(0.0, 1.0, shape)
    skills = np.broadcast_to(np.asarray(skill, float), raters)[:, None]
    seen[..., 0] += 0.5 * skills
    seen[..., 1] -= 0.5 * skills
    seen[..., 2] -= 0.5 * skills + 1.0
    clips = np.array([[f"c{k}{i}" for i in range(3)] for k in range(scenes)], object)
    names = [f"rater {row}" for row in range(raters)]
    return Answers(names, realism, seen > 0.0, rng.gamma(2.0, 2.0, shape), clips)
