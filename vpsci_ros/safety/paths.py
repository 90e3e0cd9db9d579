"""Where two recorded paths cross, and when each agent was there."""

import math

from vpsci_ros.safety.compiled import kernel
from vpsci_ros.safety.inputs import Floats


@kernel
def first_crossing(
    x: Floats, y: Floats, ahead: float, heading: float, ped_x: Floats, ped_y: Floats
) -> tuple[float, float, float, float]:
    """First point of the pedestrian's path that lies on the vehicle's, as (vehicle step, pedestrian step, x, y).

    Steps are fractional, of float64[T] positions [m]. The vehicle's path goes on straight for `ahead` metres along
    `heading` [rad], its last one; on that part its step is infinity, since it has not been there. NaN when the paths
    do not cross.
    """
    last = x.size - 1
    end_x, end_y = x[last] + ahead * math.cos(heading), y[last] + ahead * math.sin(heading)
    low_x, high_x = min(x.min(), end_x), max(x.max(), end_x)
    low_y, high_y = min(y.min(), end_y), max(y.max(), end_y)
    for j in range(ped_x.size - 1):
        ax, ay, bx, by = ped_x[j], ped_y[j], ped_x[j + 1], ped_y[j + 1]
        left, right, bottom, top = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
        if right < low_x or left > high_x or top < low_y or bottom > high_y:
            continue
        best_walked, best_driven = math.inf, math.inf
        for i in range(last + 1):
            cx, cy = x[i], y[i]
            dx, dy = (x[i + 1], y[i + 1]) if i < last else (end_x, end_y)
            if right < min(cx, dx) or left > max(cx, dx) or top < min(cy, dy) or bottom > max(cy, dy):
                continue
            across = (bx - ax) * (dy - cy) - (by - ay) * (dx - cx)
            walked = ((cx - ax) * (dy - cy) - (cy - ay) * (dx - cx)) / across
            driven = ((cx - ax) * (by - ay) - (cy - ay) * (bx - ax)) / across
            if 0.0 <= walked <= 1.0 and 0.0 <= driven <= 1.0 and walked < best_walked:
                best_walked = walked
                best_driven = i + driven if i < last else math.inf
        if best_walked <= 1.0:
            point_x, point_y = ax + best_walked * (bx - ax), ay + best_walked * (by - ay)
            return best_driven, j + best_walked, point_x, point_y
    return math.nan, math.nan, math.nan, math.nan
