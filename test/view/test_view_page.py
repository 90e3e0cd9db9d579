"""The page in a real browser, opened from disk: it plays, filters, pairs, obeys the keyboard and its address."""

from pathlib import Path
from typing import Any

import browser as real
import numpy as np
import pytest
from view.motion import episode

from vpsci_ros.view.view_page import FIELDS, Shown, Source, shown, write_view
from vpsci_ros.world import load_scenario

ROAD = load_scenario(1)
ODD = '<img src=x onerror="alert(1)">&"\'</script>{{ 1 }} é☃'


def approach(name: str, *, speed: float, scenario: int = 1, frames: int = 101, marks: tuple[str, ...] = ()) -> Shown:
    """A vehicle east along y = 0 at `speed`, a pedestrian north along x = 12 m; CurvTTC falls until they are past."""
    t = np.arange(frames) * 0.05
    values = np.zeros((frames, len(FIELDS)))
    values[:, 0], values[:, 3] = speed * t, speed
    values[:, 5], values[:, 6], values[:, 8] = 12.0, -3.0 + 1.2 * t, 1.2
    values[:, 9] = np.where(t < 2.0, 12.0 / speed - t, np.inf).clip(0.05)
    values[:, 10] = (t > 0.5) & (t < 2.0)
    outcome = "collision" if speed > 5.0 else "goal"
    road = ROAD if scenario else 0
    group = "LocationA_PedCross_S-N" if scenario else ODD
    return shown(episode(values, name, group, road, outcome, period=0.05, marks=marks))


@pytest.fixture(scope="module")
def sources() -> list[Source]:
    own = [approach(f"1:{k}", speed=3.0 + k, marks=("hard_braking",) if k == 2 else ()) for k in range(4)]
    others = [approach(f"1:{k}", speed=3.5 + k) for k in range(4)]
    people = [approach(f"{k}{ODD}", speed=3.0 + 0.2 * k, scenario=0, frames=40 + k) for k in range(9)]
    return [Source("ads", "the ADS", 0.05, own, 4), Source("autopilot", "autopilot", 0.05, others, 4),
            Source("people", f"people {ODD}", 0.05, people, 30)]  # fmt: skip


@pytest.fixture(scope="module")
def path(sources: list[Source], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "page.html"
    write_view(path, sources, f"All of it {ODD}")
    return path


def names(page: Any) -> list[str]:
    return page.locator("#list .name").all_text_contents()


def drawn(page: Any, panel: str, canvas: str = "scene") -> str:
    """Return what is on a canvas, as text that differs where a pixel does."""
    return page.evaluate(f"document.querySelector('#panel-{panel} .{canvas}').toDataURL()")


def test_it_plays_pauses_and_stops_at_the_end(browser: Any, path: Path) -> None:
    with real.opened(browser, path, "#a=ads&episode=1:0&t=4") as page:
        before = drawn(page, "a")
        page.select_option("#rate", "0.1")
        page.click("#play")
        real.wait_until(page, "page.clock > 4.02")
        assert drawn(page, "a") != before
        page.evaluate("document.activeElement.blur()")
        page.keyboard.press("Space")
        at = page.evaluate("page.clock")
        assert not page.evaluate("page.playing")
        page.evaluate("page.setRate(4)")
        page.keyboard.press("Space")
        real.wait_until(page, f"!page.playing && page.clock === page.duration && page.duration > {at}")
        assert page.text_content("#play").endswith("play")


def test_the_state_between_frames_is_that_of_the_motion(browser: Any, path: Path) -> None:
    with real.opened(browser, path, "#a=ads&episode=1:2&t=1.025") as page:
        state = page.evaluate("stateAt(page.panels[0].episode, page.clock)")
        middle = page.evaluate("page.panels[0].episode.middle")
        assert state["x"] + middle[0] == pytest.approx(5.0 * 1.025, abs=0.01)
        assert state["ped_y"] + middle[1] == pytest.approx(-3.0 + 1.2 * 1.025, abs=0.01)
        assert state["curvttc"] == pytest.approx(12.0 / 5.0 - 1.0, abs=0.002)
        assert "1.02 s · vehicle 5.0 m/s, +0.0 m/s² · pedestrian 1.2 m/s" in page.text_content("#readout-a")


def test_the_predicted_arc_is_a_circle_of_the_curvature_and_ends_after_a_quarter_turn(browser: Any, path: Path) -> None:
    with real.opened(browser, path, "#t=0") as page:
        car = "{x: 0, y: 0, heading: 0, speed: 5, curvature: 0.1}"
        end = page.evaluate(f"onArc({car}, arcTime({car}))")
        assert [end["x"], end["y"], end["heading"]] == pytest.approx([10.0, 10.0, np.pi / 2])
        touch = page.evaluate("contactPoint({x: 0, y: 0, heading: 0}, {x: 5, y: 2}, [4, 2, 0.3])")
        assert [touch["x"], touch["y"]] == [2.0, 1.0]


def test_filters_and_order_choose_the_list(browser: Any, path: Path) -> None:
    with real.opened(browser, path, "#a=ads&t=0") as page:
        assert names(page)[-1] == "1:3", "the collision last"
        page.select_option("#sort", "worst")
        assert names(page) == ["1:3", "1:2", "1:1", "1:0"], "the nearest first"
        page.select_option("#outcome", "collision")
        assert names(page) == ["1:3"]
        assert page.text_content("#shown").startswith("1 of 4")
        page.click("#all")
        page.select_option("#sort", "source")
        page.select_option("#mark", "hard_braking")
        assert names(page) == ["1:2"]
        page.click("#all")
        page.fill("#below", "1")
        assert names(page) == ["1:2", "1:3"]
        page.fill("#text", "nothing of the kind")
        assert (names(page), page.is_visible("#nothing")) == ([], True)


def test_failures_are_filtered_by_their_group_and_found_by_its_words(browser: Any, tmp_path: Path) -> None:
    made = [
        approach(f"1:{k}", speed=6.0 + k)._replace(failure=f"hits: {who}") for k, who in enumerate(("child", "adult"))
    ]
    write_view(tmp_path / "page.html", [Source("ads", "the ADS", 0.05, [*made, approach("1:9", speed=3.0)], 3)], "all")
    with real.opened(browser, tmp_path / "page.html", "#a=ads&t=0") as page:
        page.select_option("#failure", "hits: child")
        assert names(page) == ["1:0"]
        assert "failure=hits%3A+child" in page.evaluate("location.hash")
        page.click("#all")
        page.fill("#text", "ADULT")
        assert names(page) == ["1:1"]


def test_keys_go_through_episodes_and_frames(browser: Any, path: Path) -> None:
    with real.opened(browser, path, "#a=ads&sort=source&episode=1:1&t=1") as page:
        for key, episode, clock in (
            ("ArrowRight", 1, 1.05), ("ArrowLeft", 1, 1.0), ("Shift+ArrowRight", 1, 2.0), ("n", 2, 0.0),
            ("End", 2, 5.0), ("p", 1, 0.0), ("p", 0, 0.0), ("p", 0, 0.0),
        ):  # fmt: skip
            page.keyboard.press(key)
            assert page.evaluate("page.panels[0].index") == episode, key
            assert page.evaluate("page.clock") == pytest.approx(clock), key
        page.keyboard.press("f")
        page.keyboard.press("n")
        assert page.input_value("#text") == "n", "a key in a field is a letter"
        page.focus("#play")
        page.keyboard.press("-")
        assert page.evaluate("page.rate") == 0.5
        page.keyboard.press("?")
        assert page.is_visible("#help")


def test_the_same_episode_of_two_drivers_stands_side_by_side(browser: Any, path: Path) -> None:
    with real.opened(browser, path, "#a=ads&b=autopilot&sort=source&episode=1:2&t=1") as page:
        assert page.is_visible("#panel-b")
        assert page.evaluate("page.panels.map((p) => p.episode.name)") == ["1:2", "1:2"]
        assert page.evaluate("page.panels.map((p) => p.delay)") == [0, 0]
        page.keyboard.press("n")
        assert page.evaluate("page.panels.map((p) => p.episode.name)") == ["1:3", "1:3"]


def test_recorded_and_generated_ones_are_paired_by_rank_and_meet_at_the_onset(browser: Any, path: Path) -> None:
    with real.opened(browser, path, "#a=ads&b=people&sort=source&episode=1:3&t=0") as page:
        assert page.evaluate("page.panels[1].index") == 8
        page.click("#other-previous")
        assert page.evaluate("page.panels[1].index") == 7
        onsets = page.evaluate("page.panels.map((p) => p.delay + p.episode.onset * p.episode.period)")
        assert onsets[0] == pytest.approx(onsets[1])
        page.select_option("#b", "")
        assert not page.is_visible("#panel-b")


def test_a_slider_goes_from_a_failure_to_its_nearest_success(browser: Any, tmp_path: Path) -> None:
    again = [approach(name, speed=speed) for name, speed in (("as it was", 5.0), ("by 1", 4.0), ("by 2", 3.0))]
    steps = [{"amount": n, "name": each.episode.name, "fails": n < 2} for n, each in enumerate(again)]
    changes = {"1:0": [{"title": "slower at the onset", "unit": "m/s", "steps": steps, "nearest": 2}]}
    path = tmp_path / "why.html"
    failures = Source("ads", "ads", 0.05, [approach("1:0", speed=5.0), approach("1:1", speed=5.0)], 2)
    write_view(path, [failures, Source("why", "driven again", 0.05, again, 3, changes)], "why")
    with real.opened(browser, path, "#a=ads&b=why&episode=1:0&t=1") as page:
        assert page.locator("#changed").inner_text() == "by 2 m/s: avoids it", "it begins at the nearest success"
        page.locator("#amount").fill("0")
        assert page.locator("#changed").inner_text() == "as it was: fails"
        assert page.locator("#clock").inner_text().startswith("1.00"), "at the same time of the episode"
        page.locator("#next").click()
        assert not page.locator("#changes").is_visible(), "nothing was changed in this one"


def test_an_address_of_something_that_is_not_there_says_so(browser: Any, path: Path) -> None:
    with real.opened(browser, path, "#a=nobody&episode=99:9&t=0") as page:
        assert page.text_content("#notice").startswith("Not on this page: source nobody, episode 99:9 of ")
        assert page.is_visible("#notice")
    with real.opened(browser, path, "#a=ads&episode=1:3&t=0") as page:
        assert not page.is_visible("#notice")


def test_an_address_brings_back_what_is_shown(browser: Any, path: Path) -> None:
    with real.opened(browser, path, "#a=ads&t=0") as page:
        page.select_option("#b", "people")
        page.select_option("#outcome", "collision")
        page.keyboard.press("v")
        page.evaluate("page.goTo(1.5)")
        address, shown = page.evaluate("location.hash"), "page.panels.map((p) => [p.source.key, p.episode.name])"
        before = page.evaluate(shown)
    with real.opened(browser, path, address) as page:
        assert page.evaluate(shown) == before
        assert page.evaluate("page.clock") == 1.5
        assert page.input_value("#outcome") == "collision"


def test_odd_names_are_shown_as_they_are(browser: Any, path: Path) -> None:
    with real.opened(browser, path, "#a=people&t=0&sort=source") as page:
        assert page.title() == f"All of it {ODD}"
        assert names(page)[0] == f"0{ODD}"
        assert page.locator("#group option").all_text_contents() == ["all places", ODD]
        assert page.text_content("#shown") == "9 of 9 of 30, evenly spread"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_a_phone(browser: Any, path: Path, scheme: str) -> None:
    phone = {"width": 360, "height": 740}
    with real.opened(browser, path, "#a=ads&b=people&t=1", viewport=phone, color_scheme=scheme) as page:
        assert page.evaluate("document.documentElement.scrollWidth") == 360
        assert not page.is_visible("#list"), "the list is folded away"
        page.click("summary")
        assert page.is_visible("#list")


def test_a_thousand_episodes_of_ten_seconds_are_below_20_mb_and_are_all_listed(browser: Any, tmp_path: Path) -> None:
    many = [approach(f"1:{k}", speed=2.0 + 0.005 * k, frames=201) for k in range(1000)]
    assert write_view(tmp_path / "many.html", [Source("many", "many", 0.05, many, 1000)], "many") < 20e6
    with real.opened(browser, tmp_path / "many.html", "#t=1") as page:
        assert len(names(page)) == 1000
