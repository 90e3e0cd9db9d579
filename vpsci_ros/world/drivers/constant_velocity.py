"""A pedestrian that sets off once, at its walking speed, and keeps its velocity."""

from vpsci_ros.world.compiled import inlined
from vpsci_ros.world.drivers import walker


@inlined
def pedestrian(episode, _i, _answers, tables, settings):  # type: ignore[no-untyped-def]
    """Return the acceleration (ax, ay) [m/s2]: 0 except in the tick in which the pedestrian sets off; False."""
    if walker.waits(episode, settings) or episode.pedestrian_vx != 0.0 or episode.pedestrian_vy != 0.0:
        return 0.0, 0.0, False
    wanted_x, wanted_y = walker.wanted(episode, episode.walking_speed, tables, settings)
    return wanted_x / settings.period, wanted_y / settings.period, False
