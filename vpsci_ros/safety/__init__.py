"""How near a collision is: CurvTTC, the measures beside it, and what an episode was.

The whole framework hangs on one number. When CurvTTC falls below 5 s both agents are handed to the policies; the
filters, the onset, the conflicts and every figure read it. The room needs numpy and numba only, so it serves outside
this package too. docs/curvttc.md has the definition and the picture. `footprint` has the two shapes, `contact` their
first contact, `crossing` the older form and `curvttc` the public measure on batches, with `curvature` for recorded
vehicles; `measures` and `encroachment` are what others use instead; `episodes` and `yielding` say what happened;
`line_of_sight` computes what parked vehicles hide.
"""

from vpsci_ros.safety.curvature import curvature_from_positions, curvature_from_yaw_rate
from vpsci_ros.safety.curvttc import CONFLICT_TTC, CRITICAL_TTC, HORIZON, curvttc, curvttc_pair
from vpsci_ros.safety.encroachment import post_encroachment_time
from vpsci_ros.safety.episodes import is_collision, is_conflict, least_clearance, least_curvttc, onset
from vpsci_ros.safety.footprint import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance, clearance_pair
from vpsci_ros.safety.line_of_sight import touches_box, visible_pair, visible_share
from vpsci_ros.safety.measures import closest_encounter, drac, second_order_ttc, ttc_2d
from vpsci_ros.safety.yielding import Yielded, who_yielded

__all__ = [
    "CONFLICT_TTC",
    "CRITICAL_TTC",
    "HORIZON",
    "PEDESTRIAN_RADIUS",
    "VEHICLE_LENGTH",
    "VEHICLE_WIDTH",
    "Yielded",
    "clearance",
    "clearance_pair",
    "closest_encounter",
    "curvature_from_positions",
    "curvature_from_yaw_rate",
    "curvttc",
    "curvttc_pair",
    "drac",
    "is_collision",
    "is_conflict",
    "least_clearance",
    "least_curvttc",
    "onset",
    "post_encroachment_time",
    "second_order_ttc",
    "touches_box",
    "ttc_2d",
    "visible_pair",
    "visible_share",
    "who_yielded",
]
