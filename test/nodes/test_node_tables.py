"""The pages of topics and of parameters say what the code says."""

import sys
from collections.abc import Callable
from types import ModuleType

import pytest


def test_the_pages_of_topics_and_parameters_are_those_of_the_code(
    tool: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["node_tables.py", "--check"])
    assert tool("node_tables").main() == 0, capsys.readouterr().err
