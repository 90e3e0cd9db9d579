"""CurvTTC, other measures of safety, and the outcome of an episode.

When CurvTTC falls below 5 s, the policies take control of the agents whose driver is `policy`. Filters, onset and
conflicts use it, too. This package needs numpy and numba only; docs/curvttc.md has the definition.

In reading order:

* `curvttc`: curvTTC: the least time to contact of a vehicle on an arc and a pedestrian on a line, see docs/curvttc.md
* `footprint`: the two footprints, the vehicle's oriented rectangle and the pedestrian's disc
* `contact`: first contact of a turning rectangle and a walking disc
* `crossing`: the older form of CurvTTC: the first time at which both agents occupy the point where their paths cross
* `curvature`: path curvature of a recorded vehicle, from its positions or from its yaw rate; positive to the left
* `measures`: safety measures besides CurvTTC, each with its source, on batches: 2-D and second-order TTC, DRAC
* `encroachment`: post-encroachment time: from when one agent leaves the crossing point to when the other agent
* `episodes`: the onset of an episode: the first step at which CurvTTC is critical
* `yielding`: who yielded: a rule for the classification that the paper made by eye (sections 4.2 and 4.6)
* `line_of_sight`: the visible share of a pedestrian from a point, behind parked vehicles (oriented rectangles)
* `inputs`: checks of arguments: they become float64 arrays of one shape, and an invalid value is reported
* `series`: checks of series over time, float[..., T]: one episode, or a padded batch with the length of each row
* `compiled`: compilation of functions with numba, and the division of a large batch between threads
"""

from vpsci_ros.safety.contact import contact_in_step, contact_step
from vpsci_ros.safety.curvature import curvature_from_positions, curvature_from_yaw_rate
from vpsci_ros.safety.curvttc import CONFLICT_TTC, CRITICAL_TTC, HORIZON, curvttc, curvttc_pair
from vpsci_ros.safety.encroachment import post_encroachment_time
from vpsci_ros.safety.episodes import onset
from vpsci_ros.safety.footprint import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance, clearance_pair
from vpsci_ros.safety.line_of_sight import touches_box, visible_pair, visible_share
from vpsci_ros.safety.measures import closest_encounter, drac, second_order_ttc, ttc_2d
from vpsci_ros.safety.yielding import Yielded, who_goes_first, who_yielded

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
    "onset",
    "post_encroachment_time",
    "second_order_ttc",
    "touches_box",
    "ttc_2d",
    "visible_pair",
    "visible_share",
    "who_goes_first",
    "who_yielded",
]
