"""Stage 3: a dataset from a seed and the policies' files, by this process and its workers.

A `job.Unit` is a scenario and a block of episode numbers. Nothing here imports torch: a worker starts in a second and
needs a few hundred megabytes.

In reading order:

* `generate_dataset`: `vpsci generate`: a whole dataset, resumable, by any number of workers
* `job`: the job of a dataset: the values that its episodes depend on
* `plan`: the next unit to compute, and whether a scenario is complete
* `simulate`: episodes by their numbers: world, monitor, policies and filters over one unit of work, in one thread
* `parts`: the parts of an unfinished dataset: an Arrow file for each finished unit of work
* `verify`: verification of a dataset: hash its files, simulate its episodes again and compare row by row
* `combine`: datasets made of datasets: several merged into one, or a part of one; nothing is simulated
* `bag`: chosen episodes of a dataset, simulated again and written as a bag
* `datasheet`: the datasheet of a generated dataset, its README.md: content, origin and limits
* `progress`: the progress of a generation: a bar for each scenario with kept, rejected, acceptance, rate and time left
"""
