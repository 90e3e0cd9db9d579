"""A run: its parameters, folder, record, workers and progress.

In reading order:

* `run_config`: configuration of a run: the sections of a parameter file, and the parameters that several nodes share
* `run_folder`: the folder of a run: its parameters and the record of inputs and outputs
* `record`: the record `run.json` of a run: how it ended, its inputs, outputs, results and software
* `journal`: a journal of resumable work: which of its items are done, torn, or of other work
* `identity`: the check that a folder holds the same run, for every command that resumes a run
* `output_folder`: output folders: locked by one process while it writes them, and marked where a command failed
* `files`: atomic file writes, empty output folders, and the hash of a file
* `provenance`: the environment of a result: versions of software, and the CPU model
* `plugins`: additions of other Python packages to this one, found by entry points
* `workers`: workers that compute units of work: this process, processes of this machine, or a cluster
* `processes`: child processes: each with a log and a session of its own, watched, and stopped by signals
* `stop_request`: a stop request set by signals: a plain flag, since handlers may interrupt each other
* `progress`: progress of a run on standard error
* `text_table`: Tables of numbers as text for a terminal
* `kernel_cache`: the cache of compiled kernels: one folder for each state of the sources
"""
