"""Stage 3: a dataset from a seed and a weights file, by this process and its workers.

A `job.Unit` is a scenario and a block of episode numbers; `simulate`, a pure function, turns it into episodes. `plan`
chooses the next unit, `runs.workers` (`runs.ray_workers` on a cluster) compute units, `journal` keeps finished units in
the output folder so that a stopped run resumes, and `run` makes the dataset's files from them: the same bytes on any
number of workers. `datasheet` describes the result, and `verify` simulates a dataset again and compares it with its
files.

Nothing here imports torch: a worker starts in a second and needs a few hundred megabytes.
"""
