"""Episodes as videos from above (H.264 in MP4, as the paper's 144 examples are videos), encoded by PyAV."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av

from vpsci_ros.data.episode import Episode
from vpsci_ros.extras.formats.film import SIZE, pictures
from vpsci_ros.extras.formats.run import Options
from vpsci_ros.runs.files import written_whole


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Write NAME.mp4 for each episode, a picture a frame in real time, and return how many."""
    count = 0
    for episode in episodes:
        with written_whole(folder / f"{episode.label}.mp4") as part, av.open(str(part), "w", format="mp4") as film:
            stream = film.add_stream("libx264", rate=Fraction(1.0 / episode.period).limit_denominator(1000))
            stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, "yuv420p"
            stream.options = {"crf": "23", "preset": "veryfast"}
            for picture in pictures(episode):
                film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            film.mux(stream.encode())
        count += 1
    return count
