"""Parameters as fields of frozen dataclasses: declared once, checked, and read from ROS 2 parameter files.

A configuration class lists its fields with `parameter(...)`, and with `constant(...)` those that only Python sets: a
constant is recorded and checked as a parameter is, but no node declares it and no parameter file has it. A field whose
type is another configuration class is a group, its default a value of that class; names of its parameters have a dot
(`noise.start`), as ROS 2 names nested ones. The same fields are checked here when a YAML file is read (`build`),
declared on nodes, and printed in docs/parameters.md, so that name, default, unit and range are written down exactly
once. Parameter files have the layout of ROS 2, so that the same file serves `ros2 run ... --ros-args --params-file
FILE`, `vpsci graph --params FILE` and the commands that run in process.
"""

import dataclasses
import difflib
import math
from collections.abc import Callable, Mapping
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from vpsci_ros.documents import read_yaml, shown
from vpsci_ros.errors import InvalidInput

EVERY_NODE = "/**"
T = TypeVar("T")
_TYPES = (bool, int, float, str, list[int], list[float], list[str])


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A row of a parameter table; `low` and `high` are inclusive, None without a bound."""

    name: str
    type: Any
    default: Any
    description: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...] | None
    read_only: bool
    constant: bool

    def check(self, value: Any, where: str) -> Any:
        """Check `value` against this row, and return it in the parameter's type.

        :raises InvalidInput: wrong type, NaN, out of range or not among the choices; `where` opens the message.
        """
        if isinstance(value, tuple):
            value = list(value)
        if self.type is float and type(value) is int:
            value = float(value)
        if self.type == list[float] and isinstance(value, list):
            value = [float(v) if type(v) is int else v for v in value]
        if not _is_of(value, self.type):
            raise InvalidInput(f"{where}: {self.name} must be {_type_name(self.type)}, got {shown(value)}")
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, float) and math.isnan(item):
                raise InvalidInput(f"{where}: {self.name} is not a number; expected {self._range()}")
            low, high = self._bounds()
            if isinstance(item, (int, float)) and not isinstance(item, bool) and not low <= item <= high:
                raise InvalidInput(f"{where}: {self.name} = {shown(item)} is out of range; expected {self._range()}")
            if self.choices is not None and item not in self.choices:
                raise InvalidInput(
                    f"{where}: {self.name} = {shown(item)} is unknown; expected one of {', '.join(self.choices)}"
                )
        return value

    def _bounds(self) -> tuple[float, float]:
        return -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high

    def _range(self) -> str:
        low, high = self._bounds()
        return f"{low:g} to {high:g} {self.unit}".rstrip()


def parameter(
    default: Any,
    description: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] | None = None,
    read_only: bool = True,
    constant: bool = False,
) -> Any:
    """Declare a configuration field, which is also a ROS 2 parameter unless `constant`; a `default` may be a list."""
    metadata = {
        "description": description,
        "unit": unit,
        "low": low,
        "high": high,
        "choices": choices,
        "read_only": read_only,
        "constant": constant,
    }
    if isinstance(default, list):
        return dataclasses.field(default_factory=lambda: list(default), metadata=metadata, hash=False)
    return dataclasses.field(default=default, metadata=metadata)


constant = partial(parameter, constant=True)
"""Declare a configuration field that only Python code sets: no ROS 2 parameter, and in no parameter file."""


def table(config: type) -> list[Parameter]:
    """Return a configuration class's parameters, without constants, in the order of its fields, groups included."""
    return [row for row in with_constants(config) if not row.constant]


def with_constants(config: type) -> list[Parameter]:
    """Return the parameters and constants of a configuration class, in the order of its fields, groups included.

    :raises TypeError: a field has a type that no ROS 2 parameter has.
    """
    hints = get_type_hints(config)
    rows = []
    for field in dataclasses.fields(config):
        kind, default = hints[field.name], _default(field)
        if dataclasses.is_dataclass(kind):
            for row in with_constants(kind):  # type: ignore[arg-type]
                value = attrgetter(row.name)(default)
                rows.append(dataclasses.replace(row, name=f"{field.name}.{row.name}", default=value))
            continue
        if kind not in _TYPES:
            raise TypeError(f"{config.__name__}.{field.name}: {kind} cannot be a ROS 2 parameter")
        rows.append(Parameter(field.name, kind, default, **field.metadata))
    return rows


def _default(field: dataclasses.Field[Any]) -> Any:
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


def values_of(*configs: Any) -> dict[str, Any]:
    """Return the values of configuration objects by the names of their parameters and constants."""
    return {row.name: attrgetter(row.name)(config) for config in configs for row in with_constants(type(config))}


def settings_of(*configs: Any) -> dict[str, Any]:
    """Return the values of configuration objects by the names of their parameters."""
    return {row.name: attrgetter(row.name)(config) for config in configs for row in table(type(config))}


def build(config: type[T], values: Mapping[str, Any], where: str) -> T:
    """Build `config` from `values`; missing keys take their defaults.

    :param where: what the values come from ("params/x.yaml, node learner"), the opening of each error message.
    :raises InvalidInput: an unknown key, a wrong type, a value out of range, or fields that contradict each other.
    """
    rows = {row.name: row for row in with_constants(config)}
    refuse_unknown(values, rows, where)
    checked = {name: rows[name].check(value, where) for name, value in values.items()}
    try:
        return _made(config, checked, {})
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error}") from None


def pick(config: type[T], values: Mapping[str, Any], where: str) -> T:
    """Build `config` from a section's values; names that are no fields of `config` are ignored. Errors as `build`."""
    names = {row.name for row in with_constants(config)}
    return build(config, {name: value for name, value in values.items() if name in names}, where)


def _made(config: type[T], values: Mapping[str, Any], defaults: Mapping[str, Any]) -> T:
    arguments: dict[str, Any] = {**defaults, **{name: value for name, value in values.items() if "." not in name}}
    hints = get_type_hints(config)
    for field in dataclasses.fields(config):  # type: ignore[arg-type]
        if dataclasses.is_dataclass(kind := hints[field.name]):
            front = f"{field.name}."
            group = {key.removeprefix(front): value for key, value in values.items() if key.startswith(front)}
            arguments[field.name] = _made(kind, group, vars(_default(field)))  # type: ignore[arg-type]
    return config(**arguments)


def flat(tree: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the values of nested mappings by their names with dots, as ROS 2 reads them."""
    values: dict[str, Any] = {}
    for key, value in tree.items():
        below = flat(value) if isinstance(value, Mapping) else None
        values |= {str(key): value} if below is None else {f"{key}.{name}": part for name, part in below.items()}
    return values


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values, by names with dots, as nested mappings, as in a parameter file."""
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *groups, last = name.split(".")
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})
        branch[last] = value
    return tree


def refuse_unknown(values: Mapping[str, Any], known: Mapping[str, Any], where: str) -> None:
    """Refuse a key of `values` that is not in `known`, naming the nearest known name, or all if none is near.

    :raises InvalidInput: such a key, or one value for a group of parameters.
    """
    for name in map(str, values):
        below = [key for key in known if key.startswith(f"{name}.")]
        if below:
            raise InvalidInput(f"{where}: {name} is a group of parameters, got one value; expected {', '.join(below)}")
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(sorted(known))}"
            raise InvalidInput(f"{where}: unknown parameter {name!r}; {hint}")


def read_parameter_file(path: str | Path) -> dict[str, dict[str, Any]]:
    """Read a ROS 2 parameter file: section -> name of a parameter -> unchecked value.

    :raises InvalidInput: no such file, not readable as YAML, or not laid out as a parameter file.
    """
    if not Path(path).exists():
        raise InvalidInput(f"{path}: no such parameter file; the package's own are in params/")
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise InvalidInput(f"{path}: expected sections 'node: ros__parameters: ...', got {_said(document)}")
    sections: dict[str, dict[str, Any]] = {}
    for key, section in document.items():
        name = str(key).removeprefix(f"{EVERY_NODE}/")  # in any namespace
        body = section.get("ros__parameters") if isinstance(section, dict) and len(section) == 1 else None
        if not isinstance(body, dict):
            raise InvalidInput(
                f"{path}, {key}: expected one key ros__parameters with a mapping below it, got {shown(section)}"
            )
        sections[name] = sections.get(name, {}) | flat(body)
    return sections


def check_sections(
    sections: Mapping[str, Mapping[str, Any]],
    configs: Mapping[str, tuple[type, ...]],
    where: str | Path,
    rows_of: Callable[[type], list[Parameter]] = table,
) -> dict[str, dict[str, Any]]:
    """Return the checked values of every section in `configs`; values of `/**` are merged into these sections.

    :param configs: section (node) name -> the configuration classes whose fields the section may hold.
    :param where: what the sections come from, the opening of each error message.
    :param rows_of: `with_constants` for values that a program has recorded.
    :raises InvalidInput: an unknown section or key, wrong types or ranges.
    """
    known = {name: {row.name: row for kind in kinds for row in rows_of(kind)} for name, kinds in configs.items()}
    everywhere = {key: row for rows in known.values() for key, row in rows.items()}
    checked: dict[str, dict[str, Any]] = {}
    for name, values in sections.items():
        if name != EVERY_NODE and name not in known:
            raise InvalidInput(f"{where}, {name}: unknown section; expected {EVERY_NODE} or one of {', '.join(known)}")
        rows = everywhere if name == EVERY_NODE else known[name]
        refuse_unknown(values, rows, f"{where}, {name}")
        checked[name] = {key: rows[key].check(value, f"{where}, {name}") for key, value in values.items()}
    shared = checked.pop(EVERY_NODE, {})
    return {name: {k: v for k, v in shared.items() if k in known[name]} | checked.get(name, {}) for name in known}


def as_ros_parameters(sections: Mapping[str, Mapping[str, Any]], *, any_namespace: bool = False) -> dict[str, Any]:
    """Return sections in the layout of a ROS 2 parameter file; empty lists, which ROS cannot type, are left out.

    :param any_namespace: name the nodes so that ROS 2 finds them in whatever namespace.
    """
    prefix = f"{EVERY_NODE}/" if any_namespace else ""
    return {
        prefix + name: {"ros__parameters": nested({key: value for key, value in values.items() if value != []})}
        for name, values in sections.items()
    }


def _said(document: Any) -> str:
    return "an empty file" if document is None else type(document).__name__


def _type_name(kind: Any) -> str:
    return {bool: "true or false", int: "a whole number", float: "a number", str: "text"}.get(kind, str(kind))


def _is_of(value: Any, kind: Any) -> bool:
    if kind in (bool, int, float, str):
        return type(value) is kind
    return isinstance(value, list) and all(type(v) is kind.__args__[0] for v in value)
