"""Optional parts, found by entry points; each folder may be deleted without changing the rest.

`paper` has the studies and formats of the paper, `formats` other file formats, `exam_extra` the search for failures and
other additions to the exam, `carla` another engine, `drive` the page in which a person drives, `cluster` work on
several machines. Nothing outside this folder imports it, and no part imports another one.
"""
