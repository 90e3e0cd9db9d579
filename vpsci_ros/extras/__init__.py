"""Branches, found by entry points; each folder may be deleted by itself.

`paper` has the studies and formats of the paper, `formats` other file formats, `exam_extra` the search
beside an exam, `carla` another engine, `drive` the page in which a person drives. Nothing outside this folder imports
it, and no branch imports another one.
"""
