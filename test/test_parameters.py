"""Parameters are declared once, and a file that says anything else is refused with the reason."""

from dataclasses import dataclass

import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import build, check_sections, parameter, read_parameter_file, table, values_of


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
    ],
)
def test_a_bad_file_is_refused_by_name(tmp_path, text: str, message: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text)
    with pytest.raises(InvalidInput) as caught:
        loaded(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)


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
