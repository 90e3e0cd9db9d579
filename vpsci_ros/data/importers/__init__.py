"""Importers of recordings: each format is read as clips of tracks at 0.1 s, from which near misses are cut.

`tracks` defines importers and clips, and resamples tracks; `vci`, `cqut_pvi` and `described` read formats, some by a
`layout` of columns, which `layout_file` reads from layout.yaml. `pairs` finds the near misses of clips, `summary`
describes them. `run` is the entry point, with the list of formats, to which other installed Python packages add theirs
(`docs/extending.md`).
"""

from vpsci_ros.data.importers.run import IMPORTERS, import_folders, import_trajectories, imported_clips, named
from vpsci_ros.data.importers.summary import ImportResult, SourceSummary, print_import_summary, require_near_misses
from vpsci_ros.data.importers.tracks import Clip, Importer, Track

__all__ = [
    "IMPORTERS",
    "Clip",
    "ImportResult",
    "Importer",
    "SourceSummary",
    "Track",
    "import_folders",
    "import_trajectories",
    "imported_clips",
    "named",
    "print_import_summary",
    "require_near_misses",
]
