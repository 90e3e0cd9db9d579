"""What a run says where there is no terminal."""

import itertools
import re
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from vpsci_ros.runs import progress
from vpsci_ros.runs.progress import Bars


def test_lines_come_at_their_interval_or_when_it_matters(capsys) -> None:
    with Bars(interval=1e6) as bars:
        bars.bar("a", 1, None)
        bars.line("not yet")
        bars.line("the end", now=True)
    with Bars(interval=0.0) as bars:
        bars.line("each")
    said = [line for line in capsys.readouterr().err.splitlines() if "a line follows every" not in line]
    assert said == ["  the end; 0 s gone", "  each; 0 s gone"]


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., list[str]]:
    """Return the function that gives the lines of work that lasts so many seconds, its total of 1000 done by them."""

    def said(seconds: int, done: Callable[[int], float], text: str = "") -> list[str]:
        now = [0.0]
        monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: now[0]))
        bars = Bars()
        bars.bar("episodes", 0, 1000)
        for second in range(1, seconds + 1):
            now[0] = float(second)
            bars.bar("episodes", done(second), 1000)
            bars.line(text)
        return capsys.readouterr().err.splitlines()

    return said


def test_no_two_lines_say_the_same_time_and_they_come_less_often(lines: Callable[..., list[str]]) -> None:
    """Every 10 s to 100 s, by a tenth of the time gone from then on: at most 10 + ln(36) / ln(1.1) = 47 in an hour."""
    gone = [line.split(" gone")[0].split("; ")[1] for line in lines(3600, lambda second: second / 3.6)]
    assert gone[:3] == ["10 s", "20 s", "30 s"]
    seconds = [int(text.removesuffix(" s")) for text in gone if text.endswith(" s")]
    assert 600 / 1.1 - 1 < max(seconds) < 600, "seconds until ten minutes"
    assert {text.split()[1] for text in gone[len(seconds) :]} == {"min"}
    assert len(set(gone)) == len(gone)
    assert 40 <= len(gone) <= 47


def test_a_remaining_time_does_not_grow_where_the_work_slows_down(lines: Callable[..., list[str]]) -> None:
    """Half of it in 100 s, the other half in 500 s: after 100 s the rest seems to take 100 s."""
    text = lines(600, lambda second: 5.0 * second if second <= 100 else 500.0 + second - 100)
    found = [re.search(r"(some|at least) (\d+) s left", line) for line in text]
    assert all(found[:-1]), text
    left = [int(each[2]) for each in found if each]
    assert left[0] == 190
    assert all(before >= after for before, after in itertools.pairwise(left))
    assert {each[1] for each in found[:10] if each} == {"some"}
    assert {each[1] for each in found[11:14] if each} == {"at least"}, "when more is left than was said"


def test_a_line_without_a_text_says_how_much_is_done(lines: Callable[..., list[str]]) -> None:
    assert lines(10, float) == ["  episodes 10 of 1,000; 10 s gone, some 16 min left"]
