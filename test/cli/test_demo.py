"""What the demo tells: three numbers a stage and what they mean, both agents beside each other, and how to go on."""

from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.cli import demo
from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.view.sources import Source, shown

FIGURES = {
    "closed_loop_ade": 0.4381,
    "control_closed_loop_ade": "0.3",
    "transitions": 5000,
    "updates": 31,
    "refreshes": 6,
}


def driven(number: int, outcome: str, least: float) -> Episode:
    """Return an episode of 20 frames in which nobody yields."""
    one, walk = np.linspace(0.0, 5.0, 20), np.zeros((1, 20))
    listed = Listed(f"1:{number}", "here", 1, number, outcome, least)
    return Episode(
        "",
        listed,
        None,
        0.05,
        one,
        one,
        one,
        one + 4.0,
        one,
        walk,
        walk,
        walk,
        walk + 1.0,
        walk + least,
        walk + 3.0,
        walk > 0,
    )


def test_it_tells_three_numbers_a_stage_and_ends_with_the_page(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pytest.importorskip("rclpy", reason="pip install 'vpsci_ros[ros,messages]'")
    import vpsci_ros.bags.export

    stages = []
    episodes = [shown(driven(k, "collision" if k == 0 else "goal", 1.0 + k)) for k in range(5)]
    sources = [Source("people", "people", 0.05, episodes[1:], 4), Source("trained", "trained", 0.05, episodes, 5)]

    def stage(folder: Path, number: int, changes: object) -> tuple[object, ...]:
        stages.append(number)
        return FIGURES, "weights", None

    monkeypatch.setattr(demo, "_stage", stage)
    monkeypatch.setattr(demo, "demo_sources", lambda *_: sources)
    monkeypatch.setattr(vpsci_ros.bags.export, "export_bag", lambda *_, **__: {"scenarios": {"a": {"kept": 3}}})
    demo.run_demo(tmp_path / "demo", None)
    printed = capsys.readouterr().out
    assert stages == [1, 2, 3]
    assert "error 0.44 m  |  of a control 0.30 m" in printed
    assert "5,000 transitions  |  31 updates  |  6 refreshes" in printed
    assert "4 episodes  |  3 critical  |  3 kept" in printed
    assert [row.split()[-6:] for row in printed.splitlines() if "collisions" in row] == [
        ["0", "of", "4", "1", "of", "5"]
    ]
    assert f"-m webbrowser {(tmp_path / 'demo' / demo.PAGE).as_uri()}" in printed.replace("\n", "")
    assert (tmp_path / "demo" / demo.PAGE).is_file()
