"""Stage 3: a dataset from a seed and a weights file, by this process and its workers.

A `job.Unit` is a scenario and a block of episode numbers; `simulate`, a pure function, turns it into episodes. `plan`
chooses the next unit and keeps finished ones in the output folder, so that a stopped run resumes, `runs.workers`
compute units, and `run` makes the dataset's files from them: the same bytes on any
number of workers. `verify` simulates a dataset again and compares it with its
files.

Nothing here imports torch: a worker starts in a second and needs a few hundred megabytes.
"""
