"""CARLA: the learned pedestrian as a `carla.Walker` in your own world, and CARLA's world in place of ours.

No CARLA server was at hand where this was written: what the client does without one is tested with the client, and the
calls that need one, those of `server.py` and of the actors' protocol, with a stand-in. docs/carla.md says more.
"""
