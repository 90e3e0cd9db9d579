"""An environment's scene from above as an image, north up: lane, crosswalk, vehicle, pedestrian and its velocity."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from vpsci_ros.envs.simulation import Snapshot
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world.scenario import Scenario
from vpsci_ros.world.surroundings import surroundings_of

SIZE = 480  # [pixels] width and height
MARGIN = 3.0  # [m] around the lane and the walking route
GROUND, TOWN, ROAD, STRIPES = "#e9e9e4", "#d6d6d2", "#b9b9b5", "#f7f7f4"
VEHICLE, GLASS, PEDESTRIAN = "#08519c", "#9ecae1", "#a50f15"
_CORNERS = 0.5 * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [VEHICLE_LENGTH, VEHICLE_WIDTH]
_WINDSCREEN = np.array([[0.5, 0.9], [0.5, -0.9], [0.2, -0.9], [0.2, 0.9]]) * _CORNERS[0]
_CANVAS = 2 * SIZE


class View:
    """One scenario from above, drawn at twice the size of the image and scaled down, so that edges are smooth."""

    def __init__(self, scenario: Scenario) -> None:
        lane = scenario.vehicle.path.band(scenario.vehicle.lane_width)
        points = np.concatenate([lane, scenario.pedestrian.path.points, scenario.crosswalk])
        low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
        self._scale = _CANVAS / float((high - low).max())
        self._centre = 0.5 * (low + high)
        self._ground = Image.new("RGB", (_CANVAS, _CANVAS), GROUND)
        draw = ImageDraw.Draw(self._ground)
        kerbs, marks = surroundings_of(scenario).values()
        for number, kerb in enumerate(kerbs):  # the first is the outer one
            draw.polygon(self._pixels(kerb), GROUND if number else TOWN)
        for mark in marks:
            draw.line(self._pixels(mark), STRIPES, 2)
        draw.polygon(self._pixels(lane), ROAD)
        if len(scenario.crosswalk):
            draw.polygon(self._pixels(scenario.crosswalk), STRIPES, outline=ROAD)

    def image(self, record: np.void) -> NDArray[np.uint8]:
        """Return the scene of one EPISODE record from above, uint8[480, 480, 3]."""
        picture = self._ground.copy()
        draw = ImageDraw.Draw(picture)
        c, s = np.cos(record["vehicle_heading"]), np.sin(record["vehicle_heading"])
        turn, vehicle = np.array([[c, s], [-s, c]]), np.array([record["vehicle_x"], record["vehicle_y"]])
        draw.polygon(self._pixels(vehicle + _CORNERS @ turn), VEHICLE)
        draw.polygon(self._pixels(vehicle + _WINDSCREEN @ turn), GLASS)
        pedestrian = np.array([record["pedestrian_x"], record["pedestrian_y"]])
        ahead = pedestrian + np.array([record["pedestrian_vx"], record["pedestrian_vy"]])
        (x, y), tip = self._pixels(np.array([pedestrian, ahead]))
        radius = max(8.0, PEDESTRIAN_RADIUS * self._scale)
        draw.line([(x, y), tip], PEDESTRIAN, 4)
        draw.ellipse([x - radius, y - radius, x + radius, y + radius], PEDESTRIAN)
        return np.asarray(picture.resize((SIZE, SIZE), Image.Resampling.BOX))

    def _pixels(self, points: NDArray[np.float64]) -> list[tuple[float, float]]:
        x, y = ((points - self._centre) * self._scale).T
        return list(zip((0.5 * _CANVAS + x).tolist(), (0.5 * _CANVAS - y).tolist(), strict=True))


class Views:
    """Draws the slots of a batch; a scenario's ground is drawn when first needed.

    :param mode: render mode, "rgb_array" or None.
    :raises InvalidInput: another render mode.
    """

    def __init__(self, scenarios: tuple[Scenario, ...], mode: str | None) -> None:
        if mode not in (None, "rgb_array"):
            raise InvalidInput(f"render_mode = {mode!r}: expected 'rgb_array' or None")
        self._scenarios = {scenario.number: scenario for scenario in scenarios}
        self._mode, self._drawn = mode, dict[int, View]()

    def images(self, last: Snapshot | None) -> tuple[NDArray[np.uint8], ...] | None:
        """Return each slot's scene from above, uint8[480, 480, 3]; None without a render mode or before the start."""
        if self._mode is None or last is None:
            return None
        for number in set(last.state["scenario"].tolist()) - self._drawn.keys():
            self._drawn[number] = View(self._scenarios[number])
        return tuple(self._drawn[int(record["scenario"])].image(record) for record in last.state)
