"""Episodes as videos from above (H.264 in MP4, like the paper's 144 example videos), encoded by PyAV."""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode
from vpsci_ros.extras.formats.exporters import Options
from vpsci_ros.report.canvas import new_figure, show_all
from vpsci_ros.report.world_figures import GROUND, PEDESTRIAN, VEHICLE, draw_ground, outlines
from vpsci_ros.runs.files import atomic_write

SIZE = 640  # [pixels] width and height
_MARGIN = 4.0  # [m] around all that moves


def pictures(episode: Episode) -> Iterator[NDArray[np.uint8]]:
    """Yield the scene of each frame from above, uint8[640, 640, 3]; frames without data repeat the last known one."""
    one = episode.filled()
    figure, ((axis,),) = new_figure(SIZE / 100.0, SIZE / 100.0)
    figure.set_layout_engine("none")
    axis.set_position([0.0, 0.0, 1.0, 1.0])
    axis.set_facecolor(GROUND)
    axis.set(xticks=[], yticks=[])
    if one.scenario is not None:
        draw_ground(axis, one.scenario)
    walks = np.stack([one.ped_x, one.ped_y], axis=-1)
    show_all(axis, np.concatenate([np.column_stack([one.x, one.y]), *walks]), _MARGIN)
    ways = [axis.plot([], [], color=VEHICLE if n == 0 else PEDESTRIAN, linewidth=1.5, alpha=0.5, animated=True)[0]
            for n in range(1 + len(walks))]  # fmt: skip
    boxes = outlines(np.nan_to_num([one.x, one.y, one.heading, *np.full((2, len(one)), [[one.length], [one.width]])]).T)
    car = axis.add_patch(Polygon(boxes[0], closed=True, facecolor=VEHICLE, edgecolor="white", animated=True))
    people = [axis.add_patch(Circle(walk[0], 1.5 * one.radius, facecolor=PEDESTRIAN, edgecolor="white", animated=True))
              for walk in walks]  # fmt: skip
    text = axis.text(0.02, 0.98, "", transform=axis.transAxes, va="top", fontsize=11, animated=True)
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    figure.set_dpi(100)
    canvas.draw()
    ground = canvas.copy_from_bbox(figure.bbox)
    least, walking = one.known_curvttc.min(axis=0), np.hypot(one.ped_vx, one.ped_vy)
    for frame, seconds in enumerate(one.time.tolist()):
        canvas.restore_region(ground)
        until = slice(0, frame + 1)
        for way, x, y in zip(ways, (one.x, *one.ped_x), (one.y, *one.ped_y), strict=True):
            way.set_data(x[until], y[until])
        car.set_xy(boxes[frame])
        for person, walk in zip(people, walks, strict=True):
            person.set_center(tuple(walk[frame]))
        speeds = ", ".join(f"{value:.1f}" for value in walking[:, frame])
        near = f"\nCurvTTC {least[frame]:.1f} s" if np.isfinite(least[frame]) else ""
        text.set_text(f"{seconds:.1f} s\nvehicle {one.speed[frame]:.1f} m/s\npedestrian {speeds} m/s{near}")
        for artist in (*ways, car, *people, text):
            axis.draw_artist(artist)
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Write NAME.mp4 for each episode, one picture a frame in real time, and return their number."""
    count = 0
    for episode in episodes:
        with atomic_write(folder / f"{episode.label}.mp4") as part, av.open(str(part), "w", format="mp4") as film:
            stream = film.add_stream("libx264", rate=Fraction(1.0 / episode.period).limit_denominator(1000))
            stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, "yuv420p"
            stream.options = {"crf": "23", "preset": "veryfast"}
            for picture in pictures(episode):
                film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            film.mux(stream.encode())
        count += 1
    return count
