"""What a run says where there is no terminal."""

from vpsci_ros.runs.progress import Bars, StageBar


def test_lines_come_at_their_interval_or_when_it_matters(capsys) -> None:
    with Bars(interval=1e6) as bars:
        bars.bar("a", 1, None)
        bars.line("not yet")
        bars.line("the end", now=True)
    with Bars(interval=0.0) as bars:
        bars.line("each")
    said = [line for line in capsys.readouterr().err.splitlines() if "a line every" not in line]
    assert said == ["  the end; 0 s gone", "  each; 0 s gone"]


def test_a_command_that_has_nothing_new_to_say_says_what_is_left(capsys) -> None:
    with Bars("measuring", interval=0.5) as bars:
        bars._begun -= 100.0
        bars.bar("measuring", 0, 4)
        bars.bar("measuring", 2, 4)
        said = ""
        while "s left" not in said:  # the limit of every test ends what never comes
            said += capsys.readouterr().err
    assert said.startswith("  measuring; a line every 0.5 s says how long it still takes\n")


def test_a_stage_tells_its_end_with_what_is_worth_knowing(capsys) -> None:
    with StageBar("stage 1", quiet=False) as bar:
        bar.show({"episode": 3, "episodes": 30, "closed_loop_ade": 0.5})
        bar.show({"episode": 30, "episodes": 30})
        bar.show({"simulated": 4, "episodes_wanted": 4, "collision_rate": 0.25}, "fold 2")
    said = capsys.readouterr().err.splitlines()[1:]
    assert said == [
        "  stage 1: 30 of 30; closed loop ade 0.5; 0 s gone",
        "  fold 2: 4 of 4; collision rate 0.25; 0 s gone",
    ]


def test_quiet_is_quiet(capsys) -> None:
    with StageBar("stage 1", quiet=True) as bar:
        bar.show({"episode": 30, "episodes": 30})
    assert capsys.readouterr().err == ""
