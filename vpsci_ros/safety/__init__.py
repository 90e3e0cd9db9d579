"""CurvTTC, other measures of safety, and the outcome of an episode.

When CurvTTC falls below 5 s, the policies take control of both agents. Filters, onset and conflicts use it, too. This
package needs numpy and numba only; docs/curvttc.md has the definition. `footprint` has the two shapes, `contact` their
first contact, `crossing` the older form, `curvttc` the measure on batches, `curvature` the paths of recorded vehicles.
`measures` and `encroachment` have other measures, `episodes` the onset, conflict and collision of an episode,
`yielding` who yielded, and `line_of_sight` what parked vehicles hide.
"""

from vpsci_ros.safety.contact import contact_in_step, contact_step
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
    "contact_in_step",
    "contact_step",
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
