"""The example of docs/pedestrian.md runs as it is printed, and shows somebody who reacts and comes across."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "pedestrian.md"


@pytest.mark.timeout(600)  # it compiles kernels where it is the first to need them
def test_the_example_of_the_page_is_complete_and_has_15_lines() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert len(blocks) == 1
    assert len([line for line in blocks[0].splitlines() if line.strip()]) <= 15
    shown = subprocess.run([sys.executable, "-c", blocks[0]], capture_output=True, text=True, timeout=500)
    assert shown.returncode == 0, shown.stderr
    said = (
        r"from \d\.\d\d s on it reacts to the car, 4\.\d s away; Person\(kind='adult', .*\), across after 1\d\.\d s\n"
    )
    assert re.fullmatch(said, shown.stdout)
