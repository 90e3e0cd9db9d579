"""Branches: what hangs on the package by entry points and may be deleted, each folder by itself.

`paper` holds the studies and formats of the paper, `formats` those of other people, `carla` another engine, `drive` the
page in which a person drives. Nothing outside this folder imports it, and no branch imports another one.
"""
