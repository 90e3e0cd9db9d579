"""The same units over a Ray cluster: `pip install ray` here, and the same vpsci_ros on every machine of the cluster.

Ray starts a lost task again on another machine by itself. Bits agree where the machines' CPUs do.
"""

from collections.abc import Callable
from typing import Any, Generic

from vpsci_ros.errors import require
from vpsci_ros.runs.workers import Job, Result, Unit

_made: dict[str, Callable[[Any], Any]] = {}


class RayWorkers(Generic[Unit, Result]):
    """Does units as Ray tasks of one core each.

    :param address: of the cluster ("ray://host:10001", "host:6379", "auto"), or "local" for one on this machine.
    :param size: tasks at a time; None for the cluster's cores.
    :raises NotInstalled: Ray is not installed.
    """

    here = False  # the machines of a cluster need not share a disk

    def __init__(self, job: Job[Unit, Result], address: str, size: int | None) -> None:
        require("ray")
        import ray

        self._ray = ray
        if not ray.is_initialized():
            ray.init(address, log_to_driver=False, include_dashboard=False if address == "local" else None)
        self.size = size or max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._task = ray.remote(num_cpus=1, max_retries=3)(_do)
        self._job, self._key = ray.put(job), f"{id(self)}"
        self._running: dict[Any, Unit] = {}

    def submit(self, unit: Unit) -> None:
        """Hand a unit to the cluster."""
        self._running[self._task.remote(self._key, self._job, unit)] = unit

    def collect(self) -> list[tuple[Unit, Result]]:
        """Wait for the cluster to finish a unit."""
        done, _ = self._ray.wait(list(self._running), num_returns=1)
        return [(self._running.pop(task), self._ray.get(task)) for task in done]

    def close(self) -> None:
        """Cancel what runs and leave the cluster."""
        for task in self._running:
            self._ray.cancel(task, force=True)
        self._ray.shutdown()


def _do(key: str, job: Job[Any, Any], unit: Any) -> Any:
    """Do a unit in a Ray worker, which keeps what the job made for the next one."""
    if key not in _made:
        _made.clear()
        _made[key] = job()
    return _made[key](unit)
