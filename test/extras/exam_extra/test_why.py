"""Why a failure happened: what is changed in an episode that is driven again, and what is said of it."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from class_in_process import CARELESS, class_in_process

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.conduct import run_exam
from vpsci_ros.exam.exam import Exam, prepare
from vpsci_ros.exam.view import came_first, failure_group
from vpsci_ros.extras.exam_extra.explain import explain_exam
from vpsci_ros.extras.exam_extra.factors import FACTORS, Span, case_of
from vpsci_ros.extras.exam_extra.why import Search
from vpsci_ros.lockstep.intervention import NOT_FORCED, Intervention
from vpsci_ros.resources import params_dir


def episode(speed: list[float], curvttc: list[float], ahead: float = 2.6, outcome: str = "collision") -> Episode:
    """Return an episode of a car that ends at the origin, heading east, with a pedestrian so far ahead of it."""
    frames = len(speed)
    zeros, one = np.zeros(frames), np.zeros((1, frames))
    x = np.cumsum(speed) * 0.05
    return Episode(
        "test", Listed("1:7", "A", 1, 7, outcome, 0.0), None, 0.05, x - x[-1], zeros, zeros, np.array(speed), zeros,
        one + ahead, one, one, one, np.array([curvttc]), one, one > 0, one == 0,
    )  # fmt: skip


BRAKES = episode([5.0, 4.9, 4.9, 4.9, 4.9, 4.7, 4.5, 4.5, 4.3], [9.0, 9.0, 4.0, 3.0, 2.0, 1.0, 0.5, 0.2, 0.0])


def exam(**perception: Any) -> Exam:
    sections = load(params_dir() / "ads_test.yaml").changed("ads_test", {"perception": bool(perception)})
    return prepare(sections.changed("perception", perception), "external")


def test_a_case_knows_its_onset_its_end_and_the_braking_before_it() -> None:
    case = case_of(BRAKES)
    assert (case.name, case.onset, case.end, case.braking) == ("1:7", 2, 8, 7)
    assert case.accelerations[4:] == pytest.approx([-4.0, -4.0, 0.0, -4.0])
    early = episode([5.0, 4.0, 4.0, 4.0], [9.0, 9.0, 4.0, 0.0])
    assert case_of(early).braking is None, "it was over before the onset"


def changed(factor: str, amount: float, of: Episode = BRAKES) -> Exam:
    case = case_of(of)
    return FACTORS[factor].change(exam(latency=0.2), {case.key: (case, amount)})


def intervention(factor: str, amount: float) -> Intervention:
    return changed(factor, amount).interventions[1, 7]


def test_each_factor_changes_one_thing() -> None:
    earlier = intervention("earlier", 0.1)
    assert (earlier.frame, earlier.forced) == (5, pytest.approx((-4.0,))), "two frames before frame 7"
    assert intervention("harder", 1.5) == Intervention(firmer=1.5)
    assert intervention("full", 0.15) == Intervention(frame=5, forced=(-8.88,) * 3)
    assert intervention("slower", 0.5) == Intervention(frame=2, speed=-0.5)
    assert changed("latency", 0.15).latency == pytest.approx(0.05)


def test_frames_between_spells_of_braking_are_not_forced() -> None:
    gap = episode([5.0, 4.8, 4.6, 4.6, 4.4], [4.0, 3.0, 2.0, 1.0, 0.0])
    case = case_of(gap)._replace(braking=0)
    earlier = FACTORS["earlier"].change(exam(), {case.key: (case, 0.0)})
    assert earlier.interventions[1, 7].forced == pytest.approx((-4.0, -4.0, NOT_FORCED, -4.0))


def test_what_cannot_be_varied_says_why() -> None:
    plain, late = case_of(BRAKES), exam(latency=0.2)
    rolls = case_of(episode([0.0] * 3, [4.0, 3.0, 0.0]))
    for factor, case, who, reason in (
        ("latency", plain, exam(), "in lock-step a command counts at the tick that it answers"),
        ("latency", plain, exam(reach=30.0), "perception.latency is 0"),
        ("earlier", rolls, late, "it did not brake between the onset and the contact"),
        ("harder", rolls, late, "it did not brake"),
        ("slower", rolls, late, "the vehicle stood at the onset"),
    ):
        span = FACTORS[factor].span(case, who)
        assert span.most == 0.0
        assert reason in span.reason
    assert FACTORS["latency"].span(plain, late) == Span(0.2, 0.05)
    assert FACTORS["harder"].span(plain, late).most == pytest.approx(8.88 - 4.0)


def search(span: Span, fails: Any) -> Search:
    """Return a search that is over, of a failure that `fails` decides by the amount."""
    found = Search("walker", case_of(BRAKES), "full", span)
    for halving in range(4):
        for amount in found.wanted(halving):
            found.failed[amount] = fails(amount)
    return found


def test_a_boundary_is_found_to_a_32nd_of_the_span_with_seven_episodes() -> None:
    found = search(Span(3.2), lambda amount: amount < 1.31)
    assert sorted(found.failed) == pytest.approx([0.8, 1.2, 1.3, 1.4, 1.6, 2.4, 3.2])
    assert (found.least, found.below) == pytest.approx((1.4, 1.3))
    assert found.as_json()["fails_again_at"] == []


def test_amounts_are_whole_ticks_and_none_is_tried_twice() -> None:
    found = search(Span(0.2, 0.05), lambda amount: amount < 0.12)
    assert sorted(found.failed) == pytest.approx([0.05, 0.1, 0.15, 0.2])
    assert found.least == 0.15


def test_a_larger_amount_that_fails_again_is_said_and_so_is_that_none_avoids() -> None:
    again = search(Span(4.0), lambda amount: amount < 1.5 or amount > 3.5).as_json()
    assert again["fails_again_at"] == [4.0]
    never = search(Span(4.0), lambda amount: True).as_json()
    assert (never["least"], never["reason"]) == (None, "no amount that was tried avoids it")
    assert len(never["tried"]) == 4, "nothing is halved where nothing avoids it"


def group(**given: Any) -> str:
    """Return the group of a contact of a moving car with somebody `ahead` of it, in words."""
    ahead, outcome = given.pop("ahead", 2.5), given.pop("outcome", "collision")
    row = {"scenario": 1, "kind": "child", "hidden": False, "collision": outcome == "collision",
           "moving_collision": True, "parked_collision": False} | given  # fmt: skip
    return failure_group(row, episode([5.0] * 3, [1.0] * 3, ahead=ahead, outcome=outcome))


def test_a_group_says_who_came_first_which_is_who_is_before_the_front() -> None:
    assert group(ahead=2.5) == "1: child in sight, moving vehicle, pedestrian came first"
    assert group(ahead=1.0, hidden=True) == "1: child hidden, moving vehicle, vehicle came first"
    deep = episode([12.0] * 3, [1.0] * 3, ahead=2.1)
    assert came_first(deep) == "pedestrian", "beside the front only a frame after the contact"


def test_a_group_says_what_was_hit_if_anything() -> None:
    assert group(moving_collision=False).endswith("in sight, standing vehicle, pedestrian came first")
    assert group(outcome="goal", kind="") == "1: adult in sight, no contact"
    assert group(outcome="parked_collision", parked_collision=True).endswith("in sight, hits a parked vehicle")


@pytest.fixture(scope="module")
def explained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of an exam of a driver that never brakes, to which whatever becomes critical is a failure, explained."""
    folder = tmp_path_factory.mktemp("why")
    (folder / "drivers_of_why.py").write_text(CARELESS)
    world = {"scenarios": [3], "episodes": 8, "episode_time": 6.0, "spawn": "paper"}
    own = {"pedestrians": ["walker"], "baseline": False, "failure": "conflict", "allow_standing": True}
    sections = load(params_dir() / "ads_test.yaml").changed("world_simulator", world).changed("ads_test", own)
    with pytest.MonkeyPatch.context() as patch, class_in_process():
        patch.syspath_prepend(folder)
        assert run_exam(prepare(sections, ads_class="drivers_of_why:Careless"), folder / "exam", quiet=True) == []
        own_page = folder / "exam" / "why" / "report.html"
        assert explain_exam(folder / "exam", 1, workers=1, quiet=True) == own_page
        times = {path: path.stat().st_mtime_ns for path in own_page.parent.rglob("run.json")}
        explain_exam(folder / "exam", 1, workers=1, quiet=True)
        assert {path: path.stat().st_mtime_ns for path in times} == times, "what is done is not done again"
        (folder / "drivers_of_why.py").write_text(CARELESS + "\n")
        with pytest.raises(InvalidInput, match="ads_files_sha256"):
            explain_exam(folder / "exam", 1, workers=1, quiet=True)
        (folder / "drivers_of_why.py").write_text(CARELESS)
    return folder / "exam"


def test_at_the_limit_the_worst_failure_is_looked_at_first_and_the_rest_is_said_to_be_left_out(
    explained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first run comes to its end whatever the limit, and none follows it; the runs that are done count as any."""
    monkeypatch.syspath_prepend(explained.parent)
    exam = shutil.copytree(explained, tmp_path / "exam", ignore=shutil.ignore_patterns("why"))
    with class_in_process():
        page = explain_exam(exam, 3, workers=1, quiet=True, limit=0.0).read_text()
        cut = json.loads((exam / "why" / "report.json").read_text())
        explain_exam(exam, 1, workers=1, quiet=True)
    whole = json.loads((exam / "why" / "report.json").read_text())
    found, (worst,) = cut["pedestrians"]["walker"], whole["pedestrians"]["walker"]["analysed"]
    assert (cut["budget"]["limit_reached"], cut["budget"]["drives"]) == (True, 1)
    assert [each["episode"] for each in found["analysed"]] == [worst["episode"]]
    assert len(found["not_reached"]) == min(3, found["failures"]) - 1
    for factor in ("full", "slower"):
        each = found["analysed"][0]["factors"][factor]
        assert (each["tried"], each["complete"]) == ({}, False)
        assert each["reason"] == "no amount that was tried avoids it, the limit of time was reached"
    assert f"Not driven again with walker, does not react:\n{', '.join(found['not_reached'])}." in page
    assert not whole["budget"]["limit_reached"]
    assert (
        worst["factors"]
        == json.loads((explained / "why" / "report.json").read_text())["pedestrians"]["walker"]["analysed"][0][
            "factors"
        ]
    )


def test_an_exam_whose_system_drove_nothing_is_refused_by_what_the_exam_said(explained: Path, tmp_path: Path) -> None:
    exam = shutil.copytree(explained, tmp_path / "exam", ignore=shutil.ignore_patterns("why"))
    table = pq.read_table(exam / "episodes.parquet")
    alone = table.filter(pc.equal(table["pedestrian"], "alone"))
    assert len(alone) > 0
    pq.write_table(alone, exam / "episodes.parquet")
    report = json.loads((exam / "report.json").read_text()) | {"failures": ["walker: it answered NaN"]}
    (exam / "report.json").write_text(json.dumps(report))
    with pytest.raises(InvalidInput, match="so none is driven again; the exam said: walker: it answered NaN"):
        explain_exam(exam, 1, workers=1, quiet=True)
    (exam / "exam.json").unlink()
    with pytest.raises(InvalidInput, match=r"exam: no exam; expected exam\.json in it"):
        explain_exam(exam, 1, workers=1, quiet=True)


def test_failures_are_explained_and_played_by_groups(explained: Path) -> None:
    why = json.loads((explained / "why" / "report.json").read_text())
    table = pl.read_parquet(explained / "episodes.parquet")
    failed = table.filter((pl.col("pedestrian") == "walker") & pl.col("conflict")).height
    found = why["pedestrians"]["walker"]
    (analysed,) = found["analysed"]
    assert found["failures"] == failed
    assert analysed["repeats"]
    factors = analysed["factors"]
    assert factors["latency"]["reason"].startswith("nothing comes late")
    assert factors["earlier"]["reason"] == "it did not brake between the onset and the contact"
    for factor in ("full", "slower"):
        least = factors[factor]["least"]
        assert len(factors[factor]["tried"]) >= 4
        assert factors[factor]["reason"] if least is None else factors[factor]["fails_at"] < least
    assert why["budget"]["drives"] == 1 + sum(len(each["tried"]) for each in factors.values())
    packed = re.search("id=episodes>(.*?)</script>", (explained / "why" / "view.html").read_text(), re.DOTALL)
    played = json.loads(packed[1])["sources"][0]["episodes"] if packed else []
    assert sum("failure" in each for each in played) == failed, "each has the group by which the page filters"
    page = (explained / "why" / "report.html").read_text()
    assert f"view.html#a=ads-walker&amp;b=why-walker&amp;episode={analysed['episode']}" in page
