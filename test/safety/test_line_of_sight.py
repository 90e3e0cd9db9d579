"""What is seen of a disc beside rectangles, against shapes that can be worked out by hand, and against many rays."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import visible_share
from vpsci_ros.safety.line_of_sight import touches_box

WALL = [5.0, 0.0, math.pi / 2, 4.0, 0.2]  # across the way, from y = -2 to 2, its near face at x = 4.9


def test_a_pedestrian_on_the_line_of_the_walls_end_is_half_seen() -> None:
    # The shadow's edge goes from the origin through the near corner (4.9, 2); a disc centred on it is seen by half.
    edge = np.array([4.9, 2.0]) / math.hypot(4.9, 2.0)
    for distance in (7.0, 20.0):
        assert visible_share(0.0, 0.0, *(distance * edge), [WALL]) == pytest.approx(0.5, abs=1e-12)


def test_the_share_is_that_of_the_angle() -> None:
    # Of a disc of radius 1 at 10 m, half an angle of asin(0.1); the shadow ends 0.05 rad to the left of its centre.
    half, shadow = math.asin(0.1), 0.05
    wall = [2.0, 0.5 * (2.0 * math.tan(shadow) - 5.0), math.pi / 2, 5.0 + 2.0 * math.tan(shadow), 1e-9]
    expected = (half - shadow) / (2.0 * half)
    assert visible_share(0.0, 0.0, 10.0, 0.0, [wall], radius=1.0) == pytest.approx(expected, abs=1e-8)


def by_rays(eye: NDArray, disc: NDArray, boxes: NDArray, radius: float, rays: int = 4001) -> float:
    """Return the share of rays through a disc that reach it before any of the boxes."""
    distance = math.hypot(*(disc - eye))
    half = math.asin(radius / distance)
    angles = np.linspace(-half, half, rays + 2)[1:-1]
    bearing = math.atan2(*(disc - eye)[::-1])
    first = distance * np.cos(angles) - np.sqrt(radius**2 - (distance * np.sin(angles)) ** 2)
    free = np.ones(rays, bool)
    for x, y, heading, length, width in boxes:
        steps = np.linspace(0.0, 1.0, 800)[:, None] * first
        px, py = eye[0] + steps * np.cos(bearing + angles) - x, eye[1] + steps * np.sin(bearing + angles) - y
        forward, left = np.cos(heading) * px + np.sin(heading) * py, np.cos(heading) * py - np.sin(heading) * px
        free &= ~((abs(forward) < length / 2) & (abs(left) < width / 2)).any(axis=0)
    return float(free.mean())


def test_it_agrees_with_rays_wherever_everything_lies() -> None:
    rng, compared = np.random.default_rng(3), 0
    for _ in range(60):
        eye, disc = rng.uniform(-12.0, 12.0, (2, 2))
        count = rng.integers(1, 5)
        boxes = np.column_stack([rng.uniform(-10.0, 10.0, (count, 2)), rng.uniform(-7.0, 7.0, count),
                                 rng.uniform(1.0, 6.0, count), rng.uniform(0.5, 2.5, count)])  # fmt: skip
        relative = [np.array([[np.cos(h), np.sin(h)], [-np.sin(h), np.cos(h)]]) @ (disc - [x, y])
                    for x, y, h, _, _ in boxes]  # fmt: skip
        apart = all(max(abs(r[0]) - b[3] / 2, abs(r[1]) - b[4] / 2) > 0.3 for r, b in zip(relative, boxes, strict=True))
        if apart and math.hypot(*(disc - eye)) > 0.5:
            found = visible_share(*eye, *disc, boxes)
            assert found == pytest.approx(by_rays(eye, disc, boxes, 0.3, 801), abs=0.02), (eye, disc, boxes)
            compared += 1
    assert compared > 10


def test_rows_are_each_for_itself() -> None:
    xs, ys = np.linspace(1.0, 12.0, 40), np.linspace(-3.0, 3.0, 40)
    together = visible_share(0.0, 0.0, xs, ys, [WALL])
    assert together.tolist() == [visible_share(0.0, 0.0, x, y, [WALL]) for x, y in zip(xs, ys, strict=True)]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((math.nan, 0.0, 1.0, 0.0, [WALL]), "eye_x = nan: expected a finite number"),
        ((0.0, 0.0, 1.0, 0.0, [[1.0, 2.0]]), r"boxes: expected \[K, 5\]"),
        ((0.0, 0.0, 1.0, 0.0, [[1.0, 2.0, 0.0, 0.0, 1.0]]), "sizes above 0"),
    ],
)
def test_bad_input_is_refused_by_name(arguments: tuple, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        visible_share(*arguments)


@pytest.mark.parametrize(
    ("x", "y", "heading", "touching"),
    [
        (0.0, 0.0, 0.0, True),
        (4.689, 0.0, 0.0, True),  # two Model 3 bumper to bumper, 1 mm deep
        (4.691, 0.0, 0.0, False),
        (0.0, 1.849, 0.0, True),
        (0.0, 1.851, 0.0, False),
        # One across the other's bumper: (4.69 + 1.85) / 2 = 3.27 m.
        (3.269, 0.0, math.pi / 2, True),
        (3.271, 0.0, math.pi / 2, False),
        # A corner on the middle of the bumper: 4.69 / 2 + (4.69 + 1.85) / 2 / sqrt(2) = 4.6573 m ahead, and
        # (4.69 - 1.85) / 2 / sqrt(2) = 1.0041 m to the side.
        (4.657, 1.0041, math.pi / 4, True),
        (4.658, 1.0041, math.pi / 4, False),
        (-3.9, 3.0, -math.pi / 4, False),  # both bounding boxes overlap, a side lies between
    ],
)
def test_rectangles_touch_where_no_side_lies_between_them(x: float, y: float, heading: float, touching: bool) -> None:
    box = np.array([0.0, 0.0, 0.0, 4.69, 1.85])
    turned = np.array([x, y, heading, 4.69, 1.85])
    assert touches_box(x, y, heading, box) == touching
    assert touches_box(0.0, 0.0, 0.0, turned) == touching
