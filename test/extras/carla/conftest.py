"""CARLA's client of release 0.9.15, in a folder of its own: one environment holds one release of it."""

import subprocess
import sys

import pytest
from nodes.conftest import closed, context, domain, weights  # noqa: F401 (fixtures)

OLDER = "carla-0-9-15==0.0.1"  # a distribution of client 0.9.15, whose own wheels end before Python 3.10


@pytest.fixture(scope="session")
def client_0_9_15(tmp_path_factory):
    """Return a folder to put into PYTHONPATH in which `carla` is 0.9.15."""
    folder = tmp_path_factory.mktemp("carla-0.9.15")
    pip = [sys.executable, "-m", "pip", "-qq", "--disable-pip-version-check", "install", "--no-deps", "--no-compile"]
    try:
        subprocess.run([*pip, "--target", folder, OLDER], check=True, capture_output=True, timeout=120)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"pip could not install {OLDER}: {(error.stderr or b'').decode()[-300:] or error}")
    return folder
