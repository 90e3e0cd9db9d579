"""Additions of other Python packages to this one, found by entry points.

A package that is installed beside this one names its additions in its own `pyproject.toml`. Then their names work like
built-in ones: in parameter files, on the command line and in code. `docs/extending.md` has a page for each kind.
Nothing of another package is imported before its name is used. The folders of `vpsci_ros/extras/` add their parts in
the same way; a deleted folder takes its additions with it.
See https://packaging.python.org/en/latest/specifications/entry-points/.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Generic, TypeVar

from vpsci_ros.errors import InvalidInput

T = TypeVar("T")
_PACKAGE = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class PluginGroup(Generic[T]):
    """One kind of addition: this package's built-in objects and those of other Python packages.

    :ivar group: of the entry points, such as "vpsci_ros.importers".
    :ivar what: one of them is called, in error messages.
    :ivar kind: class that each has to be an instance of.
    :ivar built_in: this package's own, by name; others cannot take their names.
    """

    group: str
    what: str
    kind: type[T]
    built_in: Mapping[str, T]

    def names(self) -> tuple[str, ...]:
        """Return the built-in names, then the added ones in alphabetical order.

        :raises InvalidInput: two packages add the same name, or one a built-in name.
        """
        return (*self.built_in, *sorted(self._added()))

    def find(self, name: str) -> T:
        """Return the built-in or added object of this name.

        :raises InvalidInput: nothing has it, or what is installed under it cannot be imported or is something else.
        """
        if name in self.built_in:
            return self.built_in[name]
        added = self._added()
        if name not in added:
            known = ", ".join(self.names())
            raise InvalidInput(f"unknown {self.what} {name!r}; expected one of {known}, or install what adds it")
        return self._load(added[name])

    def origin(self, name: str) -> str:
        """Return the Python package that adds a name, and its version; "" for a built-in name."""
        point = self._added().get(name)
        return f"{point.dist.name} {point.dist.version}" if point and point.dist else ""

    def _added(self) -> dict[str, EntryPoint]:
        added: dict[str, EntryPoint] = {}
        for point in filter(_is_there, entry_points(group=self.group)):
            if point.name in self.built_in:
                raise InvalidInput(
                    f"{_owner(point)} adds {self.what} {point.name!r}, which is built in; rename it there"
                )
            if point.name in added:
                raise InvalidInput(
                    f"{_owner(added[point.name])} and {_owner(point)} both add {self.what} {point.name!r}; "
                    "uninstall one of them"
                )
            added[point.name] = point
        return added

    def _load(self, point: EntryPoint) -> T:
        where = f"{_owner(point)}, entry point {point.name} = {point.value} of {self.group}"
        try:
            loaded = point.load()
        except Exception as error:
            raise InvalidInput(f"{where}: {type(error).__name__}: {error}; mend that package") from error
        if not isinstance(loaded, self.kind):
            kind = f"{self.kind.__module__}.{self.kind.__qualname__}"
            raise InvalidInput(f"{where}: expected an instance of {kind}, got {loaded!r}; mend that package")
        return loaded


def _is_there(point: EntryPoint) -> bool:
    """Return whether an entry point is another package's, or of a folder of `extras` that exists."""
    package, extras, *branch = (*point.module.split(".")[:3], "")
    return (package, extras) != (_PACKAGE.name, "extras") or (_PACKAGE / extras / branch[0]).is_dir()


def _owner(point: EntryPoint) -> str:
    return f"package {point.dist.name}" if point.dist else "a package without a name"
