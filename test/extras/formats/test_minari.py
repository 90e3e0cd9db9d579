"""Demonstrations say what each agent saw, did and was paid for; Minari itself reads them, where it is installed."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from vpsci_ros.extras.formats.exporters import export
from vpsci_ros.view.episode_sources import read_episodes
from vpsci_ros.world.observation import AGENTS

BAG = "bags/LocationA_PedCross_S-N"


@pytest.fixture(scope="module")
def written(request, tmp_path_factory):
    """Folder of Minari datasets of a shipped bag's episode, and the episode."""
    bag = request.config.rootpath / BAG
    folder = tmp_path_factory.mktemp("minari") / "out"
    assert export(bag, ["minari"], folder) == {"minari": 2}
    (episode,) = read_episodes(bag)
    return folder / "minari", episode


@pytest.mark.parametrize("agent", AGENTS)
def test_what_was_done_leads_from_what_was_seen_to_what_is_seen_next(written, agent):
    folder, episode = written
    rows = pq.read_table(folder / f"vpsci/{agent}-v0/data/0/part-0.parquet")
    seen, done = (np.array(rows[name].to_pylist()) for name in ("observations", "actions"))
    assert len(seen) == -(-len(episode) // 2), "every second frame of 0.05 s"
    assert rows.num_rows - 1 == json.loads((folder / f"vpsci/{agent}-v0/data/metadata.json").read_text())["total_steps"]
    heading = episode.heading[::2]
    east, north = (episode.vx, episode.vy) if agent == "vehicle" else (episode.ped_vx[0], episode.ped_vy[0])
    for axis, along in enumerate((np.cos(heading) * east[::2] + np.sin(heading) * north[::2],
                                  np.cos(heading) * north[::2] - np.sin(heading) * east[::2])):  # fmt: skip
        assert seen[:, axis] == pytest.approx(along, abs=1e-4)
    turn = np.exp(-1j * heading[:-1])
    change = np.diff(east[::2] + 1j * north[::2]) * turn / 0.1
    assert done[:-1] == pytest.approx(np.column_stack([change.real, change.imag]), abs=1e-3)
    assert np.hypot(*seen[:, 2:4].T) == pytest.approx(episode.distance[0, ::2], abs=1e-3)


def test_minari_reads_what_was_written(written, monkeypatch):
    minari = pytest.importorskip("minari", reason="pip install minari")
    folder, episode = written
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    data = minari.load_dataset("vpsci/pedestrian-v0")
    (one,) = data.iterate_episodes()
    assert data.total_steps == len(one) == len(one.actions) == len(one.observations) - 1
    assert one.observations.shape[1:] == data.observation_space.shape == (6,)
    assert one.actions.dtype == np.float32
    assert (bool(one.terminations[-1]), bool(one.truncations[-1])) == (True, False)
    assert one.infos["curvttc"].min() == pytest.approx(episode.least_curvttc, abs=0.1)
