"""The pages of topics and of parameters say what the code says, of each parameter once."""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from vpsci_ros.cli.parameter_file import ELSEWHERE
from vpsci_ros.parameters import table

ROOT = Path(__file__).resolve().parents[2]


def test_the_pages_of_topics_and_parameters_are_those_of_the_code(
    tool: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["node_tables.py", "--check"])
    assert tool("node_tables").main() == 0, capsys.readouterr().err


def test_the_page_of_parameters_describes_every_parameter_and_none_twice() -> None:
    page = (ROOT / "docs" / "parameters.md").read_text(encoding="utf-8")
    lines = re.findall(r"^\| `(.*)$", page, re.MULTILINE)
    classes = {config for stage in ELSEWHERE for kinds in stage.sections.values() for config in kinds}
    assert {line.partition("`")[0] for line in lines} == {row.name for config in classes for row in table(config)}
    assert len(set(lines)) == len(lines)
