"""Real recordings in, near misses out: every format becomes clips of tracks at 0.1 s, and then the same thing happens.

`tracks` reads, checks and resamples; `vci` knows one pair of published data sets; `pairing` puts each vehicle together
with each pedestrian and keeps the near misses; `result` is what comes out; `run` is the door, with the list of formats.
"""

from vpsci_ros.data.importers.pairing import AFTER, BEFORE
from vpsci_ros.data.importers.result import ImportResult, SourceSummary, joined, print_import_summary
from vpsci_ros.data.importers.run import FORMATS, import_folders, import_trajectories

__all__ = [
    "AFTER",
    "BEFORE",
    "FORMATS",
    "ImportResult",
    "SourceSummary",
    "import_folders",
    "import_trajectories",
    "joined",
    "print_import_summary",
]
