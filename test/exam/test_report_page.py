"""The page of an exam: complete, self-contained, and safe whatever a command line or a failure says."""

import re
from html import unescape
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from exam.test_measures import CONFIG, drive

from vpsci_ros.exam.comparison import Earlier, compare
from vpsci_ros.exam.criteria import check, parse, sentence
from vpsci_ros.exam.exam import DRIVERS, ExamConfig
from vpsci_ros.exam.measures import episode_table
from vpsci_ros.exam.report import make_report
from vpsci_ros.exam.report_page import BOTTOM, FARTHEST, distances, must_see, rates, write_page
from vpsci_ros.exam.result import Conduct, RunResult

FIVE = list(DRIVERS)
EXAM = {
    "ads": "python 'my <ads>.py' & co",
    "ads_files_sha256": {"my_ads.py": 64 * "a"},
    "weights_sha256": 64 * "b",
    "software": {"python": "3.11"},
    "cpu": "a kind of CPU",
    "parameters": {"world_simulator": {"seed": 7}, "pedestrian_policy": {"weights": "people"}},
}


_WIDEST = "Math.max(...[...document.querySelectorAll('{}')].map(each => each.getBoundingClientRect().width))"


def episodes(pedestrian, driver, collide):
    """Twelve episodes of 10 s, all critical, of which the first `collide` end in a contact at 1, 2, ... m/s."""
    made = [drive(np.full(201, 1.0 + k), curvttc=1.0, episode=k, outcome="collision") for k in range(collide)]
    made += [drive(np.linspace(5.0, 0.5, 201), curvttc=3.0, episode=k) for k in range(collide, 12)]
    return made, episode_table(RunResult(made), [], driver=driver, pedestrian=pedestrian)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """(text of the page, table) of an exam of two pedestrians, one of which the ADS hits more often."""
    folder = tmp_path_factory.mktemp("page")
    found = {("learned", "ads"): 2, ("walker", "ads"): 5, ("learned", "autopilot"): 1, ("walker", "autopilot"): 1}
    made = {key: episodes(*key, collide) for key, collide in found.items()}
    table = pl.concat([rows for _, rows in made.values()])
    report = make_report(table, {"learned": Conduct(12), "walker": Conduct(12, refused=3)}, CONFIG)
    report |= {"exam": EXAM, "failures": [], "criteria": []}
    drives = {name: made[name, "ads"][0] for name in ("learned", "walker")}
    write_page(folder / "report.html", report, table, drives, "view.html")
    write_page(folder / "alone.html", report, table, drives)
    assert "view.html" not in (folder / "alone.html").read_text(encoding="utf-8")
    return (folder / "report.html").read_text(encoding="utf-8"), table


def test_the_first_paragraph_counts_the_contacts_with_the_learned_pedestrian(page):
    text = re.sub(r"\s+", " ", re.sub("<[^>]+>", " ", page[0]))
    assert "With the default pedestrian, 2 of 12 episodes end in a contact: 16.7% [4.7, 44.8]" in text
    assert "The rule-based autopilot has a contact in 8.3% [1.5, 35.4] of these episodes. In 0.0%" in text


def test_the_first_paragraph_says_how_many_critical_episodes_begin_beyond_the_range(tmp_path):
    # Of speeds to 5 m/s, distances to 40 m, walking speeds to 3 m/s and any angle: three of twelve drive at 8 m/s.
    reach = np.repeat([[0.0, 5.0], [0.0, 40.0], [0.0, 3.0], [0.0, 180.0]], [1, 4], axis=1)
    made = [drive(np.full(40, 3.0 if k < 9 else 8.0), curvttc=3.0, episode=k) for k in range(12)]
    table = episode_table(RunResult(made), [], driver="ads", pedestrian="learned", reach=reach)
    assert table["range"].to_list() == 9 * ["within"] + 3 * ["beyond"]
    report = make_report(table, {"learned": Conduct(12)}, CONFIG) | {"exam": EXAM, "failures": [], "criteria": []}
    write_page(tmp_path / "report.html", report, table, {"learned": made}, "view.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "mark=beyond_range" in text
    words = re.sub(r"\s+", " ", re.sub("<[^>]+>", " ", text))
    assert "3 of 12 critical episodes with the default pedestrian (25%) begin beyond the range" in words
    assert "Look at these episodes by themselves before you rely on them" in words


def test_the_page_may_run_no_script_and_send_nothing(page):
    (policy,) = re.findall('http-equiv=Content-Security-Policy content="([^"]*)"', page[0])
    assert policy.startswith("default-src 'none'; script-src 'none'; ")


def test_a_number_opens_the_episodes_that_it_counts(page):
    link = 'href="view.html#a=ads-learned&amp;b=autopilot-learned&amp;mark=collision">'
    assert f"{link}2</a> of 12 episodes end in a contact" in re.sub(r"\s+", " ", page[0])
    assert 'href="view.html#a=autopilot-walker&amp;b=&amp;mark=critical">' in page[0]


def test_the_three_episodes_to_see_are_three_and_each_says_why(page):
    rows = must_see(page[1])
    assert [(row["pedestrian"], row["episode"], row["why"]) for row in rows] == [
        ("walker", 4, "The hardest contact: 5.0 m/s"),
        ("walker", 3, "A contact at 4.0 m/s, where the autopilot has none"),
        ("learned", 2, "The nearest without a contact: CurvTTC 3.00 s"),
    ]
    cards = page[0].split("<ul class=cards>")[1].split("</ul>")[0]
    assert re.findall(r"episode=([\d:]+)", cards) == [f"{row['scenario']}:{row['episode']}" for row in rows]
    assert page[0].index('class="verdict') < page[0].index("<ul class=cards>") < page[0].index("<table")


def test_the_picture_has_rates_with_intervals_and_limits_on_one_axis_then_the_distances_of_the_worst(compared):
    made, table = episodes("walker", "ads", 5)
    report = make_report(table, {"walker": Conduct(12)}, CONFIG)
    report["criteria"] = check([parse("SR-12: moving_collision_rate > 0.25", ["walker"])], report, ["walker"])
    drawn = rates(report)
    (row,) = drawn["rows"]
    assert [text for _, text in drawn["marks"]] == ["0%", "50%", "100%"], "5 of 12, up to 68%, need the whole axis"
    (low, _), _, (high, _) = drawn["marks"]
    places = [
        (x - low) / (high - low) for x in (row["limit"], *(row["dots"][0][key] for key in ("value", "low", "high")))
    ]
    assert places == pytest.approx([0.25, 5 / 12, 0.193, 0.680], abs=0.001)
    line = distances(must_see(table), {"walker": made})["lines"][0]
    end, first = made[4], line["points"].split()[0].split(",")
    assert line["touched"]
    assert 1.0 - float(first[1]) / BOTTOM == pytest.approx(min(end.distance[0, 0], FARTHEST) / FARTHEST, abs=0.01)
    body = compared.read_text(encoding="utf-8").split("<body>")[1]
    assert body.index('class="verdict') < body.index("<svg") < body.index("<h2>"), "the picture is before the text"


def test_of_the_picture_nothing_is_cut_on_narrow_screens(compared, browser):
    outside = """[...document.querySelectorAll('svg text')].filter(each => {
        const own = each.getBoundingClientRect(), all = each.closest('svg').getBoundingClientRect()
        return own.left < all.left - 1 || own.right > all.right + 1 || own.bottom > all.bottom + 1
    }).map(each => each.textContent)"""
    for width in (390, 1000, 1279):
        tab = browser.new_page(viewport={"width": width, "height": 850})
        tab.goto(compared.as_uri())
        assert tab.evaluate("document.documentElement.scrollWidth") == width
        assert tab.evaluate(outside) == []
        assert tab.evaluate("document.querySelector('svg').getBoundingClientRect().top") < 500, "on the first screen"
        tab.close()


def test_the_page_is_readable_on_a_phone_a_wide_screen_and_paper(page, browser, tmp_path):
    (tmp_path / "report.html").write_text(page[0], encoding="utf-8")
    for width in (390, 1400):
        tab = browser.new_page(viewport={"width": width, "height": 850})
        tab.goto((tmp_path / "report.html").as_uri())
        assert tab.evaluate("document.documentElement.scrollWidth") == width
        assert tab.evaluate("document.querySelector('.beside').getBoundingClientRect().width") > 0.5 * width
        assert tab.evaluate(_WIDEST.format(".wide caption")) <= width, "captions are not cut off"
        assert tab.evaluate(_WIDEST.format(".wide td:first-child")) < 0.5 * width, "sticky, it would cover the others"
    assert tab.evaluate("document.documentElement.scrollHeight") < 5200
    assert tab.pdf(prefer_css_page_size=True).startswith(b"%PDF")
    tab.emulate_media(media="print")
    assert tab.evaluate("getComputedStyle(document.querySelector('.wide')).overflowX") == "visible", "nothing is cut"
    tab.close()


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Page of an exam with five pedestrians and both drivers, in which the ADS hits more often than before."""
    folder, config = tmp_path_factory.mktemp("compared"), ExamConfig(pedestrians=FIVE, recorded="right_turns")
    made = {(name, driver): episodes(name, driver, 11) for name in FIVE for driver in ("ads", "autopilot")}
    table = pl.concat([rows for _, rows in made.values()])
    hit, brakes = pl.col("collision"), pl.col("hard_braking")
    before = table.filter(pl.col("driver") == "ads").with_columns(moving_collision=~hit, hard_braking=~brakes)
    report = make_report(table, {name: Conduct(12) for name in FIVE}, config)
    report["against"] = compare(table, Earlier(folder / "main", "main.py", before), SimpleNamespace(config=config))
    (verdict,) = check([parse("SR-12: moving_collision_rate > 0.5 @learned", FIVE)], report, FIVE)
    report |= {"exam": EXAM, "failures": [sentence(verdict)], "criteria": [verdict]}
    drives = {name: made[name, "ads"][0] for name in FIVE}
    write_page(folder / "report.html", report, table, drives, "view.html")
    return folder / "report.html"


def test_the_first_screen_has_the_verdict_then_what_got_worse_and_better_and_how_large_a_change_shows(compared):
    body = compared.read_text(encoding="utf-8").split("<body>")[1]
    text = unescape(re.sub(r"\s+", " ", re.sub("<[^>]+>", " ", body)))
    heads = (
        "SR-12: moving_collision_rate > 0.5 @learned: 0.9167",
        "What changed against main",
        "Worse",
        "Better",
        "The results",
    )
    places = [text.index(head) for head in heads]
    assert places == sorted(places)
    worse = text[places[2] : places[3]]
    assert "collisions, vehicle moving [points]: default pedestrian +83.3 [" in worse
    assert "with 12 episodes a change of 70 points or more would show" in worse, "all of 12 episodes differ"
    assert "no change shows in collisions; conflicts" in text[places[3] :]


def test_nothing_is_said_of_an_autopilot_that_did_not_drive_nor_of_a_change_that_too_few_would_show(tmp_path):
    drives, table = episodes("learned", "ads", 2)
    drives, table = drives[:2], table.filter(pl.col("episode") < 2)
    config = ExamConfig(pedestrians=["learned"], baseline=False)
    report = make_report(table, {"learned": Conduct(12)}, config)
    earlier = Earlier(tmp_path / "main", "main.py", table)
    report["against"] = compare(table, earlier, SimpleNamespace(config=config))
    report |= {"exam": EXAM, "failures": [], "criteria": []}
    write_page(tmp_path / "report.html", report, table, {"learned": drives}, "view.html")
    links = re.findall(r'view.html#([^"]*)"', (tmp_path / "report.html").read_text())
    assert links
    assert {"autopilot" in link for link in links} == {False}
    text = re.sub(r"\s+", " ", re.sub("<[^>]+>", " ", (tmp_path / "report.html").read_text().split("<body>")[1]))
    assert "the rule-based autopilot" not in text
    assert "default pedestrian: no change shows in collisions; collisions, vehicle moving; conflicts;" in text
    assert "; arrived. A change shows" in text, "and no change that two episodes would show, for there is none"


def test_no_table_is_wider_than_its_column_at_1280_pixels(compared, browser):
    tab = browser.new_page(viewport={"width": 1280, "height": 900})
    tab.goto(compared.as_uri())
    wide = "[...document.querySelectorAll('table')].map(each => [each.scrollWidth, each.parentElement.clientWidth])"
    found = tab.evaluate(wide)
    assert len(found) > 5
    assert all(own <= column for own, column in found), found
    assert tab.evaluate("document.querySelector('.picture').getBoundingClientRect().top") < 300, "on the first screen"
    tab.close()


def test_a_command_line_with_markup_is_shown_as_it_is(page):
    assert "my &lt;ads&gt;.py&#39; &amp; co" in page[0]
    assert "<ads>" not in page[0]
