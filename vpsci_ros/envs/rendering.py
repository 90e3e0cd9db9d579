"""An environment's scene from above as an image, north up: lane, crosswalk, vehicle, pedestrian and its velocity."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world.scenario import Scenario

SIZE = 480  # [pixels] width and height
MARGIN = 3.0  # [m] around the lane and the walking route
GROUND, ROAD, STRIPES, VEHICLE, GLASS, PEDESTRIAN = "#e9e9e4", "#b9b9b5", "#f7f7f4", "#08519c", "#9ecae1", "#a50f15"
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
    """Draws EPISODE records of several scenarios; a scenario's ground is drawn when first needed."""

    def __init__(self, scenarios: tuple[Scenario, ...]) -> None:
        self._scenarios = {scenario.number: scenario for scenario in scenarios}
        self._drawn: dict[int, View] = {}

    def image(self, record: np.void) -> NDArray[np.uint8]:
        """Return the scene of one EPISODE record from above, in its own scenario, uint8[480, 480, 3]."""
        number = int(record["scenario"])
        if number not in self._drawn:
            self._drawn[number] = View(self._scenarios[number])
        return self._drawn[number].image(record)
