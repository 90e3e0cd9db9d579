"""Maps: lanes and crosswalks as OpenDRIVE describes them, on a real map and on small ones with known answers."""

import math
from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.opendrive import OpenDriveMap

ROAD = """<road id="{id}" length="{length}" junction="-1"><planView>{pieces}</planView>
<lanes>{offset}<laneSection s="0"><left><lane id="1" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/></lane>
</left><center><lane id="0"/></center><right>
<lane id="-1" type="driving"><width sOffset="0" a="4" b="0" c="0" d="0"/></lane>
<lane id="-2" type="driving"><width sOffset="0" a="2" b="0.1" c="0" d="0"/></lane></right></laneSection></lanes>
<objects>{objects}</objects></road>"""
PIECE = '<geometry s="{s}" x="{x}" y="{y}" hdg="{hdg}" length="{length}">{kind}</geometry>'


def road(pieces: str, length: float, id: int = 1, offset: str = "", objects: str = "") -> str:  # noqa: A002
    return ROAD.format(id=id, length=length, pieces=pieces, offset=offset, objects=objects)


def write(folder: Path, *roads: str) -> Path:
    path = folder / "map.xodr"
    path.write_text(f"<OpenDRIVE>{''.join(roads)}</OpenDRIVE>", encoding="utf-8")
    return path


def straight(x=0.0, y=0.0, hdg=0.0, length=20.0, id=1, **rest):  # noqa: A002
    return road(PIECE.format(s=0, x=x, y=y, hdg=hdg, length=length, kind="<line/>"), length, id, **rest)


def end_of_reference(found: OpenDriveMap) -> tuple[float, float, float]:
    """Where the reference line of road 1 ends: x, y [m] and heading [rad], from the lanes 2 m right and 1.5 m left."""
    right, left = found.lane_centre(1, -1)[-1], found.lane_centre(1, 1)[0]
    across = left - right
    assert np.hypot(*across) == pytest.approx(3.5)
    return *(right + across * 2.0 / 3.5), math.atan2(-across[0], across[1])


def test_lanes_lie_beside_the_reference_line_and_are_driven_on_the_right(tmp_path):
    found = OpenDriveMap(write(tmp_path, straight()))
    right, left = found.lane_centre(1, -1), found.lane_centre("1", 1)
    assert np.allclose(right[[0, -1]], [[0, -2], [20, -2]])  # half of 4 m, to the right
    assert np.allclose(left[[0, -1]], [[20, 1.5], [0, 1.5]])  # half of 3 m, against the reference line
    second = found.lane_centre(1, -2)
    assert np.allclose(second[[0, -1]], [[0, -5], [20, -6]])  # 4 m and half of 2 m, growing by 0.1 m a metre


def test_an_arc_is_a_circle(tmp_path):
    length = 10.0 * math.pi / 2
    piece = PIECE.format(s=0, x=5, y=0, hdg=0, length=length, kind='<arc curvature="0.1"/>')
    points = OpenDriveMap(write(tmp_path, road(piece, length))).lane_centre(1, -1)
    assert np.allclose(np.hypot(points[:, 0] - 5, points[:, 1] - 10), 12.0)  # radius 10 and 2 m outside
    assert np.allclose(points[-1], [17, 10])


def test_a_spiral_ends_where_fresnels_integrals_say(tmp_path):
    # curvature 0 to 0.1 over 10 m: heading s^2 / 200, so 0.5 rad at the end; x = 10 (1 - 0.5^2/10 + 0.5^4/216 - ...)
    piece = PIECE.format(s=0, x=0, y=0, hdg=0, length=10, kind='<spiral curvStart="0" curvEnd="0.1"/>')
    x, y, heading = end_of_reference(OpenDriveMap(write(tmp_path, road(piece, 10))))
    assert heading == pytest.approx(0.5)
    assert x == pytest.approx(10 * (1 - 0.25 / 10 + 0.0625 / 216 - 0.015625 / 9360), abs=1e-5)
    assert y == pytest.approx(10 * (0.5 / 3 - 0.125 / 42 + 0.03125 / 1320), abs=1e-5)


@pytest.mark.parametrize(("range_", "scale"), [("normalized", 1.0), ("arcLength", 0.1)])
def test_a_parametric_cubic_is_evaluated_over_its_range(tmp_path, range_, scale):
    b, d = 10 * scale, 2 * scale**3
    kind = f'<paramPoly3 aU="0" bU="{b}" cU="0" dU="0" aV="0" bV="0" cV="0" dV="{d}" pRange="{range_}"/>'
    found = OpenDriveMap(write(tmp_path, road(PIECE.format(s=0, x=1, y=1, hdg=math.pi / 2, length=10, kind=kind), 10)))
    x, y, heading = end_of_reference(found)
    assert [x, y] == pytest.approx([1 - 2, 1 + 10])  # u forward is north here, v left is west
    assert heading - math.pi / 2 == pytest.approx(math.atan2(6, 10))


def test_a_route_joins_lanes_in_the_order_of_driving(tmp_path):
    path = write(tmp_path, straight(), straight(x=20, id=2), straight(x=40.0, y=9.0, id=3))
    points, width = OpenDriveMap(path).route([(1, -1), (2, -1)])
    assert width == 4.0
    assert np.allclose(points[[0, -1]], [[0, -2], [40, -2]])
    assert (np.diff(points[:, 0]) > 0).all()
    with pytest.raises(InvalidInput, match="lane -1 of road 3 begins 9.0 m from the end of the one before"):
        OpenDriveMap(path).route([(2, -1), (3, -1)])


def test_what_the_map_does_not_have_is_refused(tmp_path):
    poly3 = PIECE.format(s=0, x=0, y=0, hdg=0, length=9, kind='<poly3 a="0" b="0" c="0" d="0"/>')
    found = OpenDriveMap(write(tmp_path, straight(), road(poly3, 9, 2)))
    with pytest.raises(InvalidInput, match="no road 99; this map has 2 roads"):
        found.lane_centre(99, -1)
    with pytest.raises(InvalidInput, match="road 1 has no lane -3 at every place; lanes: 1, 0, -1, -2"):
        found.lane_centre(1, -3)
    with pytest.raises(InvalidInput, match="no object 3; crosswalks of this map: none"):
        found.crosswalk(3)
    with pytest.raises(InvalidInput, match="got poly3"):
        found.lane_centre(2, -1)
