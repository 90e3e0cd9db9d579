"""The sections of a parameter file as one value, from which each command and node takes its configuration."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from vpsci_ros.parameters import pick

T = TypeVar("T")


@dataclass(frozen=True)
class Sections:
    """What a parameter file or a caller sets; every other parameter has its default.

    :ivar values: section -> name of a parameter, with dots for those of groups -> value.
    """

    values: Mapping[str, Mapping[str, Any]]

    def get(self, kind: type[T], section: str) -> T:
        """Return one of a section's configuration classes.

        :raises InvalidInput: a value of another type or out of range, or values that contradict each other.
        """
        return pick(kind, self.values.get(section, {}), section)

    def changed(self, section: str, values: Mapping[str, Any]) -> "Sections":
        """Return sections in which one has these values besides its own."""
        return Sections({**self.values, section: {**self.values.get(section, {}), **values}})
