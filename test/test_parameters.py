"""Parameters are declared once, and a file that says anything else is refused with the reason."""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import pytest
import yaml

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import (
    as_ros_parameters,
    build,
    check_sections,
    parameter,
    read_parameter_file,
    table,
    values_of,
)


@dataclass(frozen=True)
class Example:
    gain: float = parameter(1.0, "a gain", unit="m", low=0.0, high=2.0)
    count: int = parameter(3, "a count", low=1, high=10)
    names: list[str] = parameter(["a"], "names", choices=("a", "b"))
    driver: str = parameter("policy", "who drives", choices=("policy", "autopilot"))

    def __post_init__(self) -> None:
        if self.gain > self.count:
            raise InvalidInput(f"gain = {self.gain} exceeds count = {self.count}")


SECTIONS = {"node": (Example,), "other": (Example,)}


def loaded(path):
    return check_sections(read_parameter_file(path), SECTIONS, path)


def test_missing_keys_take_the_declared_defaults() -> None:
    assert build(Example, {}, "here") == Example(1.0, 3, ["a"], "policy")


def test_a_whole_number_serves_where_a_number_is_expected_but_not_the_other_way_round() -> None:
    assert build(Example, {"gain": 2}, "here").gain == 2.0
    with pytest.raises(InvalidInput, match="here: count must be a whole number, got 2.0"):
        build(Example, {"count": 2.0}, "here")


def test_true_is_not_a_number() -> None:
    with pytest.raises(InvalidInput, match="count must be a whole number, got True"):
        build(Example, {"count": True}, "here")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"gian": 1.0}, "unknown parameter 'gian'; did you mean gain?"),
        ({"gain": 2.5}, "gain = 2.5 is out of range; expected 0 to 2 m"),
        ({"gain": float("nan")}, "gain is not a number"),
        ({"names": ["c"]}, "names = 'c' is unknown; expected one of a, b"),
        ({"names": "a"}, "names must be"),
        ({"driver": "autopilto"}, "expected one of policy, autopilot"),
        ({"gain": 1.5, "count": 1}, "gain = 1.5 exceeds count = 1"),
    ],
)
def test_a_bad_value_is_refused_with_place_expectation_and_value(values: dict, message: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        build(Example, values, "x.yaml, node")
    assert str(caught.value).startswith("x.yaml, node: ")
    assert message in str(caught.value)


def test_a_file_section_wins_over_the_section_for_every_node(tmp_path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("/**: {ros__parameters: {count: 5}}\nnode: {ros__parameters: {count: 7}}\n")
    assert loaded(path) == {"node": {"count": 7}, "other": {"count": 5}}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nod: {ros__parameters: {count: 5}}", "unknown section; expected /** or one of node, other"),
        ("node: {count: 5}", "expected one key ros__parameters"),
        ("node: {ros__parameters: {cuont: 5}}", "unknown parameter 'cuont'; did you mean count?"),
        ("/**: {ros__parameters: {nothing_like_it: 5}}", "unknown parameter 'nothing_like_it'"),
        ("- 1", "expected sections"),
        ("a: [", "not readable as YAML"),
    ],
)
def test_a_bad_file_is_refused_by_name(tmp_path, text: str, message: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text)
    with pytest.raises(InvalidInput) as caught:
        loaded(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)


def test_a_section_for_any_namespace_is_the_nodes(tmp_path) -> None:
    path = tmp_path / "params.yaml"
    layout = as_ros_parameters({"node": {"gain": 0.5}, "other": {"count": 7}}, any_namespace=True)
    assert list(layout) == ["/**/node", "/**/other"]
    path.write_text(yaml.safe_dump(layout))
    assert loaded(path) == {"node": {"gain": 0.5}, "other": {"count": 7}}


def test_a_missing_file_says_where_the_packages_own_are(tmp_path) -> None:
    with pytest.raises(InvalidInput, match="no such parameter file; the package's own are in params/"):
        loaded(tmp_path / "none.yaml")


def test_the_markdown_table_has_a_row_for_each_parameter(tool: Callable[[str], ModuleType]) -> None:
    rows = tool("node_tables").markdown_table(table(Example)).splitlines()[2:]
    assert len(rows) == len(table(Example)) == 4
    assert rows[0] == "| `gain` | `1.0` | m | 0 to 2 | a gain |"


def test_a_field_that_ros_cannot_hold_is_a_programming_error() -> None:
    @dataclass(frozen=True)
    class Wrong:
        value: dict[str, int] | None = parameter(None, "a mapping")

    with pytest.raises(TypeError, match="cannot be a ROS 2 parameter"):
        table(Wrong)


@dataclass(frozen=True)
class Inner:
    start: float = parameter(0.5, "where it starts", low=0.0, high=1.0)
    kinds: list[str] = parameter([], "kinds")


@dataclass(frozen=True)
class Outer:
    count: int = parameter(1, "a count")
    inner: Inner = Inner()


def test_a_group_has_parameters_with_dots_which_are_built_and_taken_apart_again() -> None:
    assert [row.name for row in table(Outer)] == ["count", "inner.start", "inner.kinds"]
    built = build(Outer, {"inner.start": 1}, "here")
    assert built == Outer(1, Inner(1.0, []))
    assert build(Outer, values_of(built), "here") == built
    with pytest.raises(InvalidInput, match=r"here: inner.start = 2.0 is out of range; expected 0 to 1"):
        build(Outer, {"inner.start": 2.0}, "here")


def test_groups_are_written_as_mappings(tmp_path) -> None:
    layout = as_ros_parameters({"node": values_of(Outer())})
    assert layout == {"node": {"ros__parameters": {"count": 1, "inner": {"start": 0.5}}}}
    path = tmp_path / "params.yaml"
    path.write_text(yaml.safe_dump(layout))
    assert check_sections(read_parameter_file(path), {"node": (Outer,)}, path)["node"] == {
        "count": 1,
        "inner.start": 0.5,
    }
