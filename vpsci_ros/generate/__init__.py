"""Stage 3: the whole dataset in this process and its workers, from a seed and a weights file.

Work is cut into `job.Unit`s, a scenario and a block of episode numbers each; `simulate` turns one into episodes, a pure
function that any process on any machine may compute. `plan` says which unit is worth computing next,
`runs.workers` (`runs.ray_workers` over a cluster) compute them, `journal` keeps finished units in the output folder, so
that a run that was stopped goes on where it was, and `assemble` makes the dataset's files from them, the same bytes
whoever computed them. `run` is all of that as one function, `datasheet` describes the result in words, and `verify`
simulates a dataset again and compares it to its files.

Nothing here imports torch: a worker starts in a second and needs a few hundred megabytes.
"""
