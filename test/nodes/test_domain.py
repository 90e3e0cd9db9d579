"""Every exam has a domain of its own, and a second graph in the same domain is refused."""

import os
from pathlib import Path

import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes import base
from vpsci_ros.nodes.domain import only_graph, own_domain
from vpsci_ros.nodes.graph import run_graph
from vpsci_ros.nodes.safety_monitor import SafetyMonitor


def test_an_error_of_the_system_within_a_domain_is_reported_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with pytest.raises(OSError, match="no space left"), own_domain():
        assert 1 <= int(os.environ["ROS_DOMAIN_ID"]) <= 100
        raise OSError("no space left")
    assert "ROS_DOMAIN_ID" not in os.environ


def test_two_at_once_have_a_domain_each_whatever_the_environment_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    domains = {"7"}
    with own_domain():
        domains.add(os.environ["ROS_DOMAIN_ID"])
        monkeypatch.setenv("ROS_DOMAIN_ID", "7")
        with own_domain():
            domains.add(os.environ["ROS_DOMAIN_ID"])
        assert os.environ["ROS_DOMAIN_ID"] == "7"
    assert os.environ["ROS_DOMAIN_ID"] == "7"
    assert len(domains) == 3


def test_a_second_graph_in_a_domain_and_namespace_is_refused_and_no_exam_takes_the_domain() -> None:
    with own_domain():
        taken = os.environ["ROS_DOMAIN_ID"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", taken)
        with only_graph(""):
            with pytest.raises(InvalidInput, match=f"another graph runs in ROS domain {taken}; wait"), only_graph(""):
                pass
            with only_graph("/left"):
                pass
            patch.delenv("ROS_DOMAIN_ID")
            with own_domain():
                assert os.environ["ROS_DOMAIN_ID"] != taken


@pytest.mark.parametrize("given", ["seven", "-1", "233"])
def test_what_is_no_domain_is_refused(monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", given)
    with pytest.raises(InvalidInput, match="expected a number from 0 to 232"), only_graph(""):
        pass


@pytest.mark.parametrize(
    ("strategy", "said"),
    [
        ("", "expected 'Enforce'"),
        ("Permissive", "expected 'Enforce'"),
        ("Enforce", "no node can be made with DDS security"),
    ],
)
def test_security_that_is_requested_and_not_to_be_had_is_refused_before_anything_starts(
    strategy: str,
    said: str,
    domain: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", strategy)
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(tmp_path))  # without keys
    with pytest.raises(InvalidInput, match=said):
        run_graph(load("stage3_generate", []), tmp_path / "run")
    assert not (tmp_path / "run").exists()
    assert base.run(SafetyMonitor, ["safety_monitor"]) == 2
    assert said in capsys.readouterr().err
