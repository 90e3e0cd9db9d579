"""Videos of episodes: as long as they are, at their frame rate, with what moves in its place."""

import numpy as np
import pytest

from vpsci_ros.extras.formats.exporters import export
from vpsci_ros.extras.formats.mp4 import SIZE, pictures
from vpsci_ros.view.episode_sources import read_episodes

BAG = "bags/LocationB_PedCross_S-N"
VEHICLE, PEDESTRIAN = (8, 81, 156), (165, 15, 21)


def middle(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Return where a colour is in a picture, mean (column, row)."""
    rows, columns = np.nonzero(np.abs(picture.astype(int) - colour).max(axis=-1) < 12)
    return np.array([columns.mean(), rows.mean()])


@pytest.fixture(scope="module")
def shown(request):
    """An episode and its pictures."""
    (episode,) = read_episodes(request.config.rootpath / BAG)
    return episode, list(pictures(episode))


def test_a_picture_a_frame_shows_both_where_they_are(shown):
    episode, seen = shown
    assert len(seen) == len(episode)
    assert {picture.shape for picture in seen} == {(SIZE, SIZE, 3)}
    points = np.concatenate(
        [np.column_stack([episode.x, episode.y]), np.column_stack([episode.ped_x[0], episode.ped_y[0]])]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    scale = SIZE / ((high - low).max() + 8.0)  # 4 m around all that moves
    for place, colour in (((episode.x, episode.y), VEHICLE), ((episode.ped_x[0], episode.ped_y[0]), PEDESTRIAN)):
        for frame in (0, len(episode) // 3):
            right, up = scale * (np.array([each[frame] for each in place]) - 0.5 * (low + high))
            found = middle(seen[frame], colour) - SIZE / 2.0
            assert found == pytest.approx([right, -up], abs=8.0), "pixels; the way that it came is paler"


def test_a_video_is_as_long_as_its_episode(request, shown, tmp_path):
    av = pytest.importorskip("av", reason="pip install 'vpsci_ros[formats]'")
    episode, seen = shown
    assert export(request.config.rootpath / BAG, ["mp4"], tmp_path / "out") == {"mp4": 1}
    with av.open(str(tmp_path / "out/mp4" / f"{episode.label}.mp4")) as film:
        (stream,) = film.streams.video
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
        assert (stream.codec_context.name, float(stream.average_rate)) == ("h264", pytest.approx(1.0 / episode.period))
    assert len(frames) == len(seen)
    assert np.abs(frames[40].astype(int) - seen[40]).mean() < 6.0
