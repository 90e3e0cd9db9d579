"""A whole world in a server: the adapter of the client's calls, and the episodes of a world that a server moves."""

import dataclasses

import numpy as np
import pytest

carla = pytest.importorskip("carla", reason="pip install 'vpsci_ros[carla]'")
pytest.importorskip("scenariogeneration", reason="pip install 'vpsci_ros[formats]'")

from extras.carla.stand_in import StandInServer  # noqa: E402

from vpsci_ros.cosim import Vehicle, Walker  # noqa: E402
from vpsci_ros.errors import InvalidInput, VpsciError  # noqa: E402
from vpsci_ros.extras.carla.server import Controls, LiveServer  # noqa: E402
from vpsci_ros.extras.carla.world import EngineWorld  # noqa: E402
from vpsci_ros.world import ENDED, RUNNING, World, WorldConfig, load_scenario  # noqa: E402
from vpsci_ros.world.loop import Loop  # noqa: E402

AUTOPILOT = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", spawn="paper")
SCENARIO = load_scenario(1)
CAR, WALKER = Vehicle(-103.9, -46.0, 1.55, 4.0), Walker(-92.9, -33.0, 0.0, 1.5)


@pytest.fixture
def stand_in(tmp_path):
    from vpsci_ros.extras.formats.opendrive import write_map

    write_map(SCENARIO, tmp_path / "road.xodr")
    return StandInServer((tmp_path / "road.xodr").read_text())


def live(stand_in, address=""):
    return LiveServer(address, 0.05, connect=lambda host, port: stand_in)


def test_a_server_is_synchronous_while_it_is_used_and_left_as_it_was_found(stand_in):
    server = live(stand_in, "elsewhere:2002/Town10HD_Opt")
    assert stand_in.loaded == "Town10HD_Opt"
    assert (stand_in.settings.synchronous_mode, stand_in.settings.fixed_delta_seconds) == (True, 0.05)
    server.place(CAR, WALKER)
    assert [actor.kind for actor in stand_in.actors] == ["vehicle.tesla.model3", "walker.pedestrian.0001"]
    assert [round(wheel.max_steer_angle, 1) for wheel in stand_in.actors[0].wheels] == [29.8, 29.8, 70.0, 70.0]
    server.place(CAR, WALKER)
    assert len(stand_in.actors) == 2, "spawned once, put elsewhere afterwards"
    for _ in range(2):
        server.close()
    assert not stand_in.settings.synchronous_mode
    assert not any(actor.alive for actor in stand_in.actors)


def test_both_are_where_they_were_put_and_move_by_a_tick_as_they_were_told(stand_in):
    server = live(stand_in)
    server.place(CAR, WALKER)
    car, walker = server.tick(Controls(0.0, 0.0, 0.0), WALKER._replace(vx=1.0, vy=0.0))
    ahead = 0.05 * 4.0
    assert (car.x, car.y) == pytest.approx((CAR.x + ahead * np.cos(1.55), CAR.y + ahead * np.sin(1.55)), abs=1e-3)
    assert car.speed == pytest.approx(4.0, abs=1e-4)
    assert walker == pytest.approx(Walker(WALKER.x + 0.05, WALKER.y, 1.0, 0.0), abs=1e-3)
    turned, _ = server.tick(Controls(0.5, 0.0, 0.0), WALKER)
    assert turned.heading > car.heading
    assert turned.curvature > 0.0, "steering to the left"


def test_what_the_server_refuses_is_said_with_what_to_do(stand_in):
    def refused(host, port):
        raise RuntimeError(f"time-out while waiting for the simulator at {host}:{port}")

    with pytest.raises(VpsciError, match=r"CARLA at 127\.0\.0\.1:2000: time-out .* is the server on"):
        LiveServer("", 0.05, connect=refused)
    with pytest.raises(InvalidInput, match="expected carla://HOST:PORT/MAP"):
        live(stand_in, "localhost:here")
    with pytest.raises(VpsciError, match="no road within 5 m of .* the eight scenarios lie in Town10HD"):
        live(stand_in).place(CAR._replace(x=500.0), WALKER)
    stand_in.try_spawn_actor = lambda kind, transform: None
    with pytest.raises(VpsciError, match=r"cannot spawn vehicle\.tesla\.model3"):
        live(stand_in).place(CAR, WALKER)


def test_an_episode_in_a_server_begins_as_ours_and_then_is_where_the_server_has_everybody(stand_in):
    episodes = [(1, 3), (1, 4)]
    own = World(AUTOPILOT, [SCENARIO], episodes, 1, 1)
    begun = own.state.copy()
    loop = Loop(EngineWorld(live(stand_in), AUTOPILOT, [SCENARIO], episodes, 1, 1))
    state = loop.world.state
    assert state.tobytes() == begun.tobytes()
    frames, outcomes, places = 0, [], []
    while not loop.world.done:
        loop.step()
        record = state[0]
        if record["status"] == RUNNING and record["frame"] > 0:
            car = stand_in.actors[0].get_transform()
            ahead = 0.2 * np.array([np.cos(record["vehicle_heading"]), np.sin(record["vehicle_heading"])])
            at = np.array([record["vehicle_x"], record["vehicle_y"]])
            assert at == pytest.approx([car.location.x + ahead[0], -car.location.y + ahead[1]], abs=1e-3)
            places.append(record["route_s"])
            frames += 1
        if record["status"] == ENDED:
            outcomes.append(int(record["outcome"]))
    assert len(outcomes) == 2
    assert frames > 100
    assert max(places) - min(places) > 5.0, "the car has driven along its lane"
    assert record["vehicle_path"] > 0.0 or outcomes


def test_what_a_server_cannot_hold_is_refused(stand_in):
    for change, batch, scenario in (
        ({"pedestrians": 2}, 1, SCENARIO),
        ({}, 2, SCENARIO),
        ({"vehicle_driver": "replay"}, 1, SCENARIO),
        ({}, 1, load_scenario(104)),
    ):
        config = dataclasses.replace(AUTOPILOT, **change)
        with pytest.raises(InvalidInput, match="expected batch = 1, pedestrians = 1, no parked vehicles"):
            EngineWorld(live(stand_in), config, [scenario], [], batch, 1)
