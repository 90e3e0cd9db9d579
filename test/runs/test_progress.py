"""What a run says where there is no terminal."""

from vpsci_ros.runs.progress import Bars, StageBar


def test_lines_come_at_their_interval_or_when_it_matters(capsys) -> None:
    with Bars(interval=1e6) as bars:
        bars.bar("a", 1, None)
        bars.line("not yet")
        bars.line("the end", now=True)
    with Bars(interval=0.0) as bars:
        bars.line("each")
    assert capsys.readouterr().err.split("\n") == ["  the end", "  each", ""]


def test_a_stage_tells_its_end_with_what_is_worth_knowing(capsys) -> None:
    with StageBar("stage 1", quiet=False) as bar:
        bar.show({"episode": 3, "episodes": 30, "closed_loop_ade": 0.5})
        bar.show({"episode": 30, "episodes": 30})
        bar.show({"simulated": 4, "episodes_wanted": 4, "collision_rate": 0.25}, "fold 2")
    assert capsys.readouterr().err == (
        "  stage 1: 30 of 30; closed loop ade 0.5\n  fold 2: 4 of 4; collision rate 0.25\n"
    )


def test_quiet_is_quiet(capsys) -> None:
    with StageBar("stage 1", quiet=True) as bar:
        bar.show({"episode": 30, "episodes": 30})
    assert capsys.readouterr().err == ""
