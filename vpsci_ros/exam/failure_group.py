"""What a failure has in common with others: by it the page filters its episodes, and `vpsci ads-why` counts them."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from vpsci_ros.data.episode import Episode
from vpsci_ros.safety import VEHICLE_LENGTH


class FailureGroup(NamedTuple):
    """What failures have in common; as text it is what the page shows.

    :ivar kind: of the pedestrian; `hidden`: behind parked vehicles as it became critical.
    :ivar contact: "moving vehicle", "standing vehicle", "parked vehicle", or "none".
    :ivar came_first: where they touch: "pedestrian", before the front, or "vehicle", touched in its side; empty: no
        contact of the two.
    """

    scenario: int
    kind: str
    hidden: bool
    contact: str
    came_first: str

    def __str__(self) -> str:
        what = {"none": "no contact", "parked vehicle": "hits a parked vehicle"}.get(self.contact, self.contact)
        first = f", {self.came_first} came first" if self.came_first else ""
        return f"{self.scenario}: {self.kind or 'adult'} {'hidden' if self.hidden else 'in sight'}, {what}{first}"


def failure_group(row: Mapping[str, Any], episode: Episode) -> FailureGroup:
    """Return the group of an episode that failed.

    :param row: of it in the table of episodes, `vpsci_ros.exam.measures.COLUMNS`.
    """
    contact = "parked vehicle" if row["parked_collision"] else "none"
    if row["collision"]:
        contact = "moving vehicle" if row["moving_collision"] else "standing vehicle"
    return FailureGroup(row["scenario"], row["kind"], row["hidden"], contact, came_first(episode))


def came_first(episode: Episode) -> str:
    """Return who came first where they touch, see `FailureGroup`."""
    if episode.outcome != "collision":
        return ""
    seen = episode.filled().pair(episode.most_critical)
    dx, dy = seen.ped_x[0, -1] - seen.x[-1], seen.ped_y[0, -1] - seen.y[-1]
    forward = math.cos(seen.heading[-1]) * dx + math.sin(seen.heading[-1]) * dy
    return "pedestrian" if forward >= 0.5 * VEHICLE_LENGTH else "vehicle"
