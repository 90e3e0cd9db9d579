"""The door of the importers: folders and format names in, one near-miss table and a summary out."""

from collections.abc import Sequence
from pathlib import Path

from vpsci_ros.data.importers.pairing import near_misses_of
from vpsci_ros.data.importers.result import ImportResult, joined
from vpsci_ros.data.importers.vci import VCI_CITR, VCI_DUT, VciFormat, find_clips, read_clip
from vpsci_ros.errors import InvalidInput

FORMATS: dict[str, VciFormat] = {form.name: form for form in (VCI_DUT, VCI_CITR)}


def import_trajectories(folder: str | Path, format_name: str) -> ImportResult:
    """Read every clip of a folder as published and return its near misses; `pairing` tells which steps are kept.

    :param format_name: a key of `FORMATS`.
    :raises InvalidInput: an unknown format, a missing folder or file, a file that does not hold what it should.
    """
    if format_name not in FORMATS:
        raise InvalidInput(f"unknown format {format_name!r}; expected one of {', '.join(FORMATS)}")
    form = FORMATS[format_name]
    clips = (read_clip(*files, form.frame_rate) for files in find_clips(folder))
    return near_misses_of(form.name, clips, length=form.length, width=form.width)


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
