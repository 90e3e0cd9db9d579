"""Importers of recordings: each format is read as clips of tracks at 0.1 s, from which near misses are cut.

Other installed Python packages add formats to the list in `import_recordings` (`docs/extending.md`).

In reading order:

* `import_recordings`: the entry point of the importers
* `tracks`: importers, clips and tracks: read from CSV with every value checked, cut at gaps
* `pairs`: near misses of clips: the CurvTTC of each vehicle with each pedestrian while both are tracked
* `described`: recordings of any other layout, whose columns the file `layout.yaml` in the same folder describes
* `layout_file`: the file `layout.yaml`, which describes the columns of recordings of any layout
* `layout`: Tables of tracks with any column names: a layout gives the column and the unit of each quantity
* `agreement`: what recordings say twice: speeds, velocities, headings and sizes, compared with positions and times
* `summary`: the result of an import: the near misses, and a summary of each source, printed and stored with the table
"""

from vpsci_ros.data.importers.import_recordings import (
    IMPORTERS,
    import_folders,
    import_trajectories,
    imported_clips,
    importers_of,
    named,
)
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
    "importers_of",
    "named",
    "print_import_summary",
    "require_near_misses",
]
