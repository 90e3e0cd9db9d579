"""A domain of one's own is given back, and an error within it stays the error that it is."""

import os

import pytest

from vpsci_ros.nodes.domain import own_domain


def test_an_error_of_the_system_within_a_domain_is_told_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with pytest.raises(OSError, match="no space left"), own_domain():
        assert 1 <= int(os.environ["ROS_DOMAIN_ID"]) <= 100
        raise OSError("no space left")
    assert "ROS_DOMAIN_ID" not in os.environ


def test_a_domain_that_the_environment_names_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    with own_domain():
        assert os.environ["ROS_DOMAIN_ID"] == "7"
    assert os.environ["ROS_DOMAIN_ID"] == "7"
