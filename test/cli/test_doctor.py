"""The doctor's report: every extra with what it brings, the kernel cache, and a message through the middleware."""

import ast
from importlib.metadata import Distribution
from pathlib import Path

import pytest

from vpsci_ros.cli import doctor
from vpsci_ros.nodes import self_test

ROOT = Path(__file__).resolve().parents[2]


def test_every_extra_has_a_line_and_a_missing_one_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "vpsci_ros").mkdir()
    (tmp_path / "vpsci_ros" / "kernel.nbc").write_bytes(bytes(3_000_000))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    found = Distribution.discover
    monkeypatch.setattr(Distribution, "discover", lambda **of: [] if of["name"] == "torch" else found(**of))
    monkeypatch.setattr(self_test, "exchange", lambda: 0.25)
    doctor.doctor()
    printed = capsys.readouterr().out
    assert "learn       missing" in printed
    assert "ros         installed" in printed
    assert f"compiled kernels: 3 MB in {tmp_path}/vpsci_ros" in printed
    assert "received its own message after 0.2 s" in printed


def test_what_extras_bring_is_said_of_all_in_setup() -> None:
    (extras,) = [
        {key.value.replace("_", "-") for key in node.value.keys}
        for node in ast.parse((ROOT / "setup.py").read_text()).body
        if isinstance(node, ast.Assign) and node.targets[0].id == "EXTRAS"
    ]
    assert set(doctor.BRINGS) == extras


def test_a_node_in_its_own_domain_receives_what_it_publishes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(self_test, "PATIENCE", 120.0)  # on a busy machine
    assert 0.0 <= self_test.exchange() < self_test.PATIENCE
