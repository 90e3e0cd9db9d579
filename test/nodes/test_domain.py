"""Every exam has a domain of its own, and a second graph in the same domain is refused."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.nodes import base, domain
from vpsci_ros.nodes.domain import only_graph, own_domain
from vpsci_ros.nodes.graph import run_graph
from vpsci_ros.nodes.safety_monitor import SafetyMonitor


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


HOLDS = """
import os, time
from vpsci_ros.nodes.domain import own_domain
with own_domain():
    print(os.environ["ROS_DOMAIN_ID"], flush=True)
    time.sleep(600)
"""


def test_a_graph_is_refused_where_an_exam_of_another_process_runs_until_that_process_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    exam = subprocess.Popen([sys.executable, "-c", HOLDS], stdout=subprocess.PIPE, text=True)
    try:
        taken = exam.stdout.readline().strip()
        monkeypatch.setenv("ROS_DOMAIN_ID", taken)
        for namespace in ("", "/left"):
            with pytest.raises(InvalidInput, match=f"an exam .* in ROS domain {taken}"), only_graph(namespace):
                pass
    finally:
        exam.send_signal(signal.SIGKILL)
        exam.communicate()
    with only_graph(""):
        pass


def test_where_every_domain_is_in_use_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with own_domain():
        number = int(os.environ["ROS_DOMAIN_ID"])
        monkeypatch.setattr(domain, "OWN", range(number, number + 1))
        with pytest.raises(VpsciError, match=f"ROS domains {number} to {number} are all in use"), own_domain():
            pass


@pytest.mark.parametrize("given", ["seven", "-1", "233"])
def test_what_is_no_domain_is_refused(monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", given)
    with pytest.raises(InvalidInput, match="expected a number from 0 to 232"), only_graph(""):
        pass


@pytest.mark.usefixtures("domain")
@pytest.mark.parametrize(
    ("strategy", "said"),
    [
        ("", "expected 'Enforce'"),
        ("Permissive", "expected 'Enforce'"),
        ("Enforce", "no node can be made with DDS security"),
    ],
)
def test_security_that_is_requested_and_not_to_be_had_is_refused_before_anything_starts(
    strategy: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", strategy)
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(tmp_path))  # without keys
    with pytest.raises(InvalidInput, match=said):
        run_graph(load("stage3_generate", []), tmp_path / "run")
    assert not (tmp_path / "run").exists()
    assert base.run_together([SafetyMonitor], ["safety_monitor"]) == 2
    assert said in capsys.readouterr().err
