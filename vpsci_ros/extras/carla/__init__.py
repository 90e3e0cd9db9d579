"""CARLA: the default pedestrian as a `carla.Walker` in your own world, and a CARLA server as the world's engine.

No CARLA server was at hand. Calls that need none are tested with CARLA's client; those of `server.py` and of the
actors' protocol with a stand-in (docs/carla.md).

In reading order:

* `walker`: the default pedestrian as a `carla.Walker` in a user's synchronous world
* `world`: a world whose agents another engine moves, such as CARLA; `World` gives spawns, hand-over and outcomes
* `server`: a CARLA server: all calls of CARLA's client that need a server, except those of the actors
* `actors`: conversion of CARLA's actors: CARLA's frame is left-handed, y to the south, degrees clockwise from x, z up
* `node`: the world in a CARLA server: `world_simulator` with `engine: carla`
* `entry`: the executable `carla_world` of `ros2 run vpsci_ros`; like `nodes.entry`, it imports quickly
"""
