"""The page of node tables says what the code says."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_of_node_tables_is_that_of_the_code() -> None:
    command = [sys.executable, str(ROOT / "tools" / "node_tables.py"), "--check"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
