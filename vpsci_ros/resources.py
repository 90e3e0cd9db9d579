"""Paths of the package's data files, for every kind of installation."""

from pathlib import Path

from vpsci_ros.errors import InvalidInput

RIGHT_TURNS = "right_turns"  # the name of the near misses that are shipped
TO_LEARN_FROM, TO_MEASURE_ON = f"{RIGHT_TURNS}/train", f"{RIGHT_TURNS}/dev"  # their two parts
_PACKAGE = Path(__file__).resolve().parent


def params_dir(package: Path = _PACKAGE) -> Path:
    """Return the folder of the parameter files and, below it, `scenarios/`.

    In a source tree (a development install, also colcon's `--symlink-install`) that is `params/` beside the package;
    otherwise pip and colcon have put it into `share/vpsci_ros/params` of a prefix above the package.

    :raises InvalidInput: the package was installed without them.
    """
    return _data_dir(package, "params", "parameter files")


def params_path(name: str | Path) -> Path:
    """Return the parameter file `name`: a path, or the name of a shipped one ("stage3_generate").

    :raises InvalidInput: there is no such file.
    """
    if Path(name).is_file():
        return Path(name)
    shipped = {path.stem: path for path in params_dir().glob("*.yaml")}
    if str(name).removesuffix(".yaml") in shipped:
        return shipped[str(name).removesuffix(".yaml")]
    raise InvalidInput(f"{name}: no such parameter file; the package's own are {', '.join(sorted(shipped))}")


def messages_dir(package: Path = _PACKAGE) -> Path:
    """Return the folder of the message definitions of vpsci_msgs (`*.msg`), found like that of `params_dir`.

    :raises InvalidInput: the package was installed without them.
    """
    return _data_dir(package, "msg_defs/msg", "message definitions")


def robot_description(agent: str) -> str:
    """Return the URDF of "vehicle" or "pedestrian", whose root link is `base_link`.

    :raises InvalidInput: the package was installed without it.
    """
    return (_data_dir(_PACKAGE, "urdf", "robot descriptions") / f"{agent}.urdf").read_text(encoding="utf-8")


def _data_dir(package: Path, folder: str, what: str) -> Path:
    source = package.parent
    if (source / "package.xml").is_file() and (source / folder).is_dir():
        return source / folder
    for prefix in (source, *source.parents):
        if (installed := prefix / "share" / package.name / folder).is_dir():
            return installed
    raise InvalidInput(
        f"{package}: expected the {what} in share/{package.name}/{folder} of a folder above it, found none;"
        " install the package again with pip or colcon"
    )


def weights_path(name: str, *, made_by: str = "vpsci people") -> Path:
    """Return the file of the policy `name`: a path, or the name of a shipped one ("people").

    :param made_by: the command that makes such a file, named where a path leads nowhere.
    :raises InvalidInput: there is no such file.
    """
    if name.endswith(".safetensors"):
        if not Path(name).is_file():
            raise InvalidInput(f"weights {name}: no such file; make one with '{made_by}', or name a shipped one")
        return Path(name)
    shipped = {path.stem: path for path in (_PACKAGE / "models").glob("*.safetensors")}
    if name not in shipped:
        known = f"the shipped {', '.join(sorted(shipped))}" if shipped else "none are shipped"
        raise InvalidInput(f"weights {name!r}: expected a .safetensors file or a shipped name ({known})")
    return shipped[name]


def recorded_onsets_path() -> Path:
    """Return the CSV file of recorded onsets, from which the spawn method `right_turns` draws."""
    return _PACKAGE / "recordings" / "onsets.csv"


def near_misses_part(name: str | Path) -> tuple[Path, str]:
    """Return the file of the near-miss table that `name` names, and its part as a prefix of clip names ("": all).

    A table is "right_turns", which is shipped with the package, or a path; a part is named as if the table were a
    folder of its clips: "right_turns/train", "mine.parquet/dev/corner1". A name of no table is returned as a path.
    """
    given = Path(name)
    for path in (given, *given.parents):
        shipped = str(path) == RIGHT_TURNS and not path.exists()
        table = _PACKAGE / "recordings" / f"{RIGHT_TURNS}.parquet" if shipped else path
        if table.is_file():
            return table, given.relative_to(path).as_posix().removeprefix(".")
    return given, ""


def near_misses_path(name: str | Path) -> Path:
    """Return the file of the near-miss table that `name` names, as a whole or in part; see `near_misses_part`."""
    return near_misses_part(name)[0]
