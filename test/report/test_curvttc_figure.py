"""The picture of docs/curvttc.md."""

import runpy
from pathlib import Path

import pytest

FIGURE = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "curvttc_figure.py"))
EDGES, TURN, draw_curvttc = (FIGURE[name] for name in ("EDGES", "TURN", "draw_curvttc"))


def test_the_scenes_show_what_their_titles_say():
    values = {scene.title: scene.ttc for scene in EDGES}
    assert values["touching now"] == 0.0
    assert values["beyond 90 degrees"] == float("inf")
    assert values["standing vehicle"] == pytest.approx((5.0 - 0.925 - 0.3) / 1.3)
    assert 0.0 < TURN.ttc < TURN.end
    assert TURN.free(TURN.ttc) == pytest.approx(0.0, abs=1e-6)


def test_the_picture_is_drawn_the_same_twice(tmp_path: Path):
    for name in ("one.png", "two.png"):
        draw_curvttc(tmp_path / name)
    one, two = ((tmp_path / name).read_bytes() for name in ("one.png", "two.png"))
    assert one[:8] == b"\x89PNG\r\n\x1a\n"
    assert one == two
