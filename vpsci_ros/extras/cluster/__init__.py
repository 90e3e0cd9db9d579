"""Work on the machines of a Dask cluster: `--cluster`, with the results of one machine.

In reading order:

* `cluster`: the command's side: units go to the cluster's workers, and results and files come back
* `cluster_worker`: the host's side: tasks of Dask, and the processes in which they have units computed
"""
