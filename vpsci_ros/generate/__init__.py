"""Stage 3: a dataset from a seed and the policies' files, by this process and its workers.

A `job.Unit` is a scenario and a block of episode numbers; `simulate` turns it into episodes. `plan`
chooses the next unit, `runs.workers` compute units, `parts` stores each as an Arrow part, so that a stopped run
resumes, and `run` joins the parts to the dataset's files: the same bytes on any number of workers. `verify` simulates a
dataset again and compares it with its files; `bag` writes chosen episodes as a bag.

Nothing here imports torch: a worker starts in a second and needs a few hundred megabytes.
"""
