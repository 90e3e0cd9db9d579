"""The door of the importers: folders and format names in, one near-miss table and a summary out."""

from collections.abc import Sequence
from pathlib import Path

from vpsci_ros.data.importers.cqut_pvi import CQUT_PVI
from vpsci_ros.data.importers.described import DESCRIBED
from vpsci_ros.data.importers.importer import Importer
from vpsci_ros.data.importers.pairing import near_misses_of
from vpsci_ros.data.importers.result import ImportResult, joined
from vpsci_ros.data.importers.vci import VCI_CITR, VCI_DUT
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.plugins import PluginGroup

BUILT_IN = {"vci-dut": VCI_DUT, "vci-citr": VCI_CITR, "cqut-pvi": CQUT_PVI, "described": DESCRIBED}
IMPORTERS = PluginGroup("vpsci_ros.importers", "format", Importer, BUILT_IN)


def import_trajectories(folder: str | Path, format_name: str) -> ImportResult:
    """Read every clip of a folder as published and return its near misses; `pairing` sets which steps are kept.

    :param format_name: of `IMPORTERS`; the table's `source`.
    :raises InvalidInput: an unknown format, a missing folder or file, a file that does not hold what it should.
    """
    importer = IMPORTERS.find(format_name)
    return near_misses_of(format_name, importer.read(Path(folder)), length=importer.length, width=importer.width)


def import_folders(folders: Sequence[str | Path], formats: Sequence[str]) -> ImportResult:
    """Import several folders into one table, interactions numbered through.

    :param formats: one for each folder, or one for all.
    :raises InvalidInput: formats that do not match the folders, the same recording twice, or see `import_trajectories`.
    """
    if len(formats) == 1:
        formats = list(formats) * len(folders)
    if not folders or len(formats) != len(folders):
        raise InvalidInput(
            f"expected one format for each folder, or one for all; got {len(folders)} folders, {len(formats)} formats"
        )
    return joined([import_trajectories(folder, form) for folder, form in zip(folders, formats, strict=True)])
