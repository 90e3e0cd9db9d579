"""CARLA: the default pedestrian as a `carla.Walker` in your own world, and a CARLA server as the world's engine.

No CARLA server was at hand. Calls that need none are tested with CARLA's client; those of `server.py` and of the
actors' protocol with a stand-in (docs/carla.md).
"""
