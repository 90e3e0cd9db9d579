"""What a run says where there is no terminal."""

from vpsci_ros.runs.progress import Bars


def test_lines_come_at_their_interval_or_when_it_matters(capsys) -> None:
    with Bars(interval=1e6) as bars:
        bars.bar("a", 1, None)
        bars.line("not yet")
        bars.line("the end", now=True)
    with Bars(interval=0.0) as bars:
        bars.line("each")
    said = [line for line in capsys.readouterr().err.splitlines() if "a line every" not in line]
    assert said == ["  the end; 0 s gone", "  each; 0 s gone"]
