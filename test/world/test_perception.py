"""What is listed of pedestrians: as they are by default; each error by itself has the size and memory that it says."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from vpsci_ros.world import load_scenarios
from vpsci_ros.world.parked import EYE_FORWARD, parked_from
from vpsci_ros.world.perception import ABSENT, HIDDEN, LOST, OUT_OF_VIEW, SEEN, PerceptionConfig, blank, perceive
from vpsci_ros.world.state import EPISODE, RUNNING

TICK = 0.05


def scene(rows: int = 1, scenario: int = 1) -> NDArray[np.void]:
    """A car at the origin that drives east, and a pedestrian 10 m ahead that walks north, in each row."""
    state = np.zeros(rows, EPISODE)
    state["status"], state["scenario"], state["episode"] = RUNNING, scenario, np.arange(rows)
    state["vehicle_speed"], state["pedestrian_x"], state["pedestrian_vy"] = 5.0, 10.0, 1.2
    return state


def watch(state: NDArray[np.void], frames: int, config: PerceptionConfig, pedestrians: int = 1) -> NDArray[np.void]:
    """Return what is listed of a scene that stands still, OBJECT[frames, R]."""
    state["pedestrian"] = np.arange(len(state)) % pedestrians
    memory, listed = blank(len(state), config, TICK), []
    for frame in range(frames):
        state["frame"] = frame
        memory, objects = perceive(memory, state, config, TICK, pedestrians=pedestrians)
        listed.append(objects)
    return np.stack(listed)


def test_by_default_everybody_is_listed_as_they_are_from_the_first_frame() -> None:
    state = scene(3)
    for name in ("pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy"):
        state[name] = np.random.default_rng(2).normal(0.0, 20.0, 3)
    listed = watch(state, 5, PerceptionConfig())
    assert (listed["status"] == SEEN).all()
    assert (listed["track"] == 1).all()
    for name in ("x", "y", "vx", "vy"):
        assert (listed[name] == state[f"pedestrian_{name}"]).all()


@pytest.mark.parametrize(
    ("bearing", "distance", "status"),
    [(59.0, 19.0, SEEN), (-59.0, 19.0, SEEN), (61.0, 19.0, OUT_OF_VIEW), (180.0, 5.0, OUT_OF_VIEW),
     (0.0, 20.01, OUT_OF_VIEW)],
)  # fmt: skip
def test_who_is_outside_of_the_view_or_too_far_is_not_listed(bearing: float, distance: float, status: int) -> None:
    state = scene()
    state["vehicle_heading"] = heading = 2.0
    angle = heading + math.radians(bearing)
    state["pedestrian_x"], state["pedestrian_y"] = distance * math.cos(angle), distance * math.sin(angle)
    state["vehicle_x"], state["vehicle_y"] = -EYE_FORWARD * math.cos(heading), -EYE_FORWARD * math.sin(heading)
    config = PerceptionConfig(field_of_view=120.0, reach=20.0)
    assert watch(state, 1, config)["status"][0, 0] == status


def test_who_is_behind_a_parked_van_is_hidden_and_listed_under_another_number_afterwards() -> None:
    parked = parked_from(load_scenarios([104]))
    state = scene(scenario=104)
    state["vehicle_x"], state["vehicle_y"] = -10.0, -69.75
    config = PerceptionConfig(least_visible=0.5)
    memory, listed = blank(1, config, TICK), []
    for frame, y in enumerate([-69.0, -76.0, -76.0, -69.0]):
        state["frame"], state["pedestrian_x"], state["pedestrian_y"] = frame, 9.0, y
        memory, objects = perceive(memory, state, config, TICK, parked)
        listed.append((int(objects["status"][0]), int(objects["track"][0])))
    assert listed == [(SEEN, 1), (HIDDEN, 0), (HIDDEN, 0), (SEEN, 2)]
    state["pedestrian_y"] = -76.0
    seen = perceive(blank(1, PerceptionConfig(), TICK), state, PerceptionConfig(), TICK, parked)[1]
    assert seen["status"][0] == SEEN, "off by default: it looks through vehicles"


def test_noise_has_its_size_and_its_correlation_in_time() -> None:
    config = PerceptionConfig(position_noise=0.3, velocity_noise=0.2, noise_time=0.5)
    state = scene(4000)
    listed = watch(state, 21, config)
    for name, size in (("x", 0.3), ("y", 0.3), ("vx", 0.2), ("vy", 0.2)):
        noise = listed[name] - state[f"pedestrian_{name}"]
        # 4,000 independent rows: the standard error of a standard deviation is 1.1%, of a correlation up to 1.6%.
        for frame in (0, 10, 20):
            assert noise[frame].std() == pytest.approx(size, rel=0.05)
        assert np.corrcoef(noise[0], noise[10])[0, 1] == pytest.approx(math.exp(-0.5 / 0.5), abs=0.07)
        assert np.corrcoef(noise[0], noise[1])[0, 1] == pytest.approx(math.exp(-0.05 / 0.5), abs=0.07)
    assert abs(np.corrcoef(listed["x"][0], listed["y"][0])[0, 1]) < 0.07
    white = watch(scene(4000), 2, PerceptionConfig(position_noise=0.3, noise_time=0.0))["x"]
    assert abs(np.corrcoef(white[0], white[1])[0, 1]) < 0.07


def test_a_lost_track_is_found_again_after_its_time_under_another_number() -> None:
    listed = watch(scene(500), 101, PerceptionConfig(lost_rate=0.5, lost_time=0.4))
    status, tracks = listed["status"], listed["track"]
    begins = (status[1:] == LOST) & (status[:-1] == SEEN)
    followed = (status[:-1] == SEEN).sum() * TICK
    assert begins.sum() / followed == pytest.approx(0.5, rel=0.1)
    row = int(np.argmax(begins[:80].any(axis=0)))
    lost = np.flatnonzero(status[:, row] == LOST)
    assert lost[:8].tolist() == list(range(lost[0], lost[0] + 8)), "0.4 s are 8 ticks"
    assert status[lost[0] + 8, row] == SEEN
    assert (tracks[lost[0] - 1, row], tracks[lost[0] + 8, row]) == (1, 2)


def test_what_is_listed_late_is_what_was_seen_then_and_nothing_before_the_episode() -> None:
    config = PerceptionConfig(latency=0.15, position_noise=0.2)
    now, late = watch(scene(3), 12, PerceptionConfig(position_noise=0.2)), watch(scene(3), 12, config)
    assert (late[:3]["status"] == ABSENT).all()
    assert late[3:].tolist() == now[:-3].tolist()
    state = scene()
    memory = blank(1, config, TICK)
    for episode in (0, 1):
        state["episode"] = episode
        for frame in range(5):
            state["frame"] = frame
            memory, objects = perceive(memory, state, config, TICK)
            assert objects["status"][0] == (SEEN if frame > 2 else ABSENT), "nothing of another episode"


ALL = PerceptionConfig(
    seed=5, field_of_view=200.0, reach=60.0, position_noise=0.2, velocity_noise=0.1, missed=0.1, latency=0.1,
    lost_rate=0.3,
)  # fmt: skip


def test_a_row_is_perceived_alike_in_every_batch_and_again() -> None:
    whole = watch(scene(9), 30, ALL)
    assert whole.tolist() == watch(scene(9), 30, ALL).tolist()
    for row in (0, 4, 8):
        assert whole[:, row].tolist() == watch(scene(9)[row : row + 1], 30, ALL)[:, 0].tolist()
    assert whole.tolist() != watch(scene(9), 30, PerceptionConfig(**{**vars(ALL), "seed": 6})).tolist()
