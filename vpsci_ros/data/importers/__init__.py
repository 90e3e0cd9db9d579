"""Importers of recordings: each format is read as clips of tracks at 0.1 s, from which near misses are cut.

`tracks` says what an importer is and what comes out of it, reads, checks, resamples, and puts each vehicle
together with each pedestrian; `vci`, `cqut_pvi` and `described` know formats, some by a `layout` of columns; `run` is
the door, with the list of formats, to which other distributions add theirs (`docs/extending.md`).
"""

from vpsci_ros.data.importers.run import (
    IMPORTERS,
    ImportResult,
    SourceSummary,
    import_folders,
    import_trajectories,
    imported_clips,
    joined,
    named,
    print_import_summary,
    require_near_misses,
)
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
    "joined",
    "named",
    "print_import_summary",
    "require_near_misses",
]
