"""Against an earlier exam: what is driven again, what is fixed, newly broken or unchanged, and how that is said."""

import json
import os
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import yaml
from class_in_process import CARELESS, class_in_process
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.parquet import write_parquet
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.comparison import Earlier, compare, failing
from vpsci_ros.exam.conduct import run_exam
from vpsci_ros.exam.criteria import check, parse
from vpsci_ros.exam.exam import ADS, Exam, prepare
from vpsci_ros.exam.junit import write_junit
from vpsci_ros.exam.markdown import _plain, write_summary
from vpsci_ros.exam.measures import COLUMNS
from vpsci_ros.exam.timing import not_met
from vpsci_ros.resources import params_dir

SHORT = {"scenarios": [1], "episodes": 4, "episode_time": 2.0}
EXAM = {"pedestrians": ["walker"], "baseline": False, "allow_standing": True, "timing": "autopilot"}


def exam(**world: Any) -> Exam:
    sections = load(params_dir() / "ads_test.yaml").changed("world_simulator", SHORT | world)
    return prepare(sections.changed("ads_test", EXAM), ads_class="my_driver:MyDriver")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder with the driver, and with an exam of it in `yesterday`."""
    folder = tmp_path_factory.mktemp("earlier")
    (folder / "my_driver.py").write_text(CARELESS.replace("Careless", "MyDriver"))
    with pytest.MonkeyPatch.context() as patch, class_in_process():
        patch.syspath_prepend(folder)
        assert run_exam(exam(), folder / "yesterday", quiet=True) == []
        yield folder


def again(home: Path, tmp_path: Path, *criteria: str, against: Path) -> tuple[list[str], dict[str, Any]]:
    """Compare today's exam, which is yesterday's, with another one; return the reasons to fail and what is said."""
    shutil.copytree(home / "yesterday", tmp_path / "today")
    reasons = run_exam(exam(), tmp_path / "today", criteria, against=against, quiet=True)
    return reasons, json.loads((tmp_path / "today" / "report.json").read_text())["against"]["pedestrians"]["walker"]


def test_the_same_system_again_changes_nothing(home: Path, tmp_path: Path) -> None:
    criteria = ["newly_failed > 0", "fixed > 0", "moving_collision_rate_change_low > 0"]
    reasons, row = again(home, tmp_path, *criteria, against=home / "yesterday")
    assert (reasons, row["fixed"], row["newly_failed"], row["same"], row["episodes"]) == ([], [], [], 4, 4)
    assert row["differences"]["arrived_rate"]["value"] == 0.0


def test_what_failed_before_and_does_not_now_is_fixed_and_the_other_way_round(home: Path, tmp_path: Path) -> None:
    table = pl.read_parquet(home / "yesterday" / "episodes.parquet")
    shutil.copytree(home / "yesterday", tmp_path / "worse")
    opposite = table.with_columns(~pl.col("moving_collision"))
    write_parquet(opposite, tmp_path / "worse" / "episodes.parquet", COLUMNS, content="episodes of an exam")
    reasons, row = again(home, tmp_path, "fixed >= 0", against=tmp_path / "worse")
    names = {
        failed: [
            f"1:{number}"
            for number in table.filter(pl.col("pedestrian") == "walker", pl.col("moving_collision") == failed)[
                "episode"
            ]
        ]
        for failed in (True, False)
    }
    assert (row["newly_failed"], row["fixed"], row["still_failing"]) == (names[True], names[False], [])
    assert reasons == [f"fixed >= 0: {len(names[False])} (walker, does not react), failed"]
    summary = (tmp_path / "today" / "summary.md").read_text()
    assert summary.startswith("## my_driver:MyDriver: failed\n")
    key = (names[True] + names[False])[0]
    assert f"[walker {key}](view.html#a=ads-walker&b=&episode={key})" in summary, "for no autopilot drove"
    assert "All changes against worse" in (tmp_path / "today" / "report.html").read_text()


def rows(*failing: int) -> pl.DataFrame:
    columns = {"outcome": "goal", "driven": 5.0, "duration": 6.0, "impact_speed": 1.0, "hardest_braking": 1.0,
               "driver": ADS, "pedestrian": "walker", "scenario": 1, "collision": False, "conflict": False,
               "severe_conflict": False, "hard_braking": False, "arrived": True, "time_lost": 1.0,
               "critical": True}  # fmt: skip
    failed = [number in failing for number in range(10)]
    return pl.DataFrame({"episode": range(10), "moving_collision": failed, "least_curvttc": 1.0}).with_columns(
        pl.lit(value).cast(pl.Int64 if name == "scenario" else None or type(value)).alias(name)
        for name, value in columns.items()
    )


@pytest.fixture(scope="module")
def verdict(home: Path) -> dict[str, Any]:
    """What is said of an exam in which 1, 4 and 9 of ten episodes fail, where 1, 2 and 3 did."""
    return compare(rows(1, 4, 9), Earlier(Path("out/old"), "old.py", rows(1, 2, 3)), exam())


def test_what_is_newly_broken_is_a_share_of_what_passed_and_what_is_fixed_of_what_failed(
    verdict: dict[str, Any],
) -> None:
    row = verdict["pedestrians"]["walker"]
    assert (row["fixed"], row["newly_failed"], row["still_failing"]) == (["1:2", "1:3"], ["1:4", "1:9"], ["1:1"])
    assert (row["fixed_rate"]["value"], row["fixed_rate"]["n"]) == (pytest.approx(2 / 3), 3)
    assert (row["newly_failed_rate"]["value"], row["newly_failed_rate"]["n"]) == (pytest.approx(2 / 7), 7)
    assert row["differences"]["moving_collision_rate"]["value"] == 0.0
    assert row["same"] == 10, "as far as these columns tell"


def test_junit_fails_what_is_newly_broken_skips_what_failed_before_and_passes_what_is_fixed(
    verdict: dict[str, Any], tmp_path: Path
) -> None:
    criterion = {"criterion": "newly_failed > 0", "pedestrian": "walker", "value": 2.0, "failed": True,
                 "requirement": "SR-12"}  # fmt: skip
    report = {"exam": {"ads": "new.py"}, "failures": ["newly_failed > 0: 2"], "criteria": [criterion],
              "conduct": {"walker": {"failure": ""}}, "timing": None, "against": verdict,
              "alone": {"arrived": 10, "of": 10},
              "drivers": {"ads": {"walker": {"episodes": 10, "arrived_rate": {"value": 0.9}}}}}  # fmt: skip
    write_verdict(tmp_path, report, rows(1, 4, 9), "")
    of = "vpsci ads-test.walker"
    assert cases(tmp_path / "junit.xml") == {
        ("vpsci ads-test.exam", "every episode was driven"): [],
        ("vpsci ads-test.exam", "arrived in 10 of 10 episodes on the empty road"): [],
        ("vpsci ads-test.exam", "newly_failed > 0 @walker"): ["failure"],
        (of, "arrived in 9 of 10 episodes"): [],
        (of, "scenario 1, episode 2"): [],
        (of, "scenario 1, episode 3"): [],
        (of, "scenario 1, episode 4"): ["failure"],
        (of, "scenario 1, episode 9"): ["failure"],
        (of, "scenario 1, episode 1"): ["skipped"],
    }
    labels = properties(tmp_path / "junit.xml")
    assert labels["newly_failed > 0 @walker"] == {"requirement": "SR-12", "pedestrian": "walker", "value": "2"}
    assert labels["scenario 1, episode 9"] == {"pedestrian": "walker", "scenario": "1", "episode": "9"}
    counts = [
        (suite.get("tests"), suite.get("failures"), suite.get("skipped"))
        for suite in ET.parse(tmp_path / "junit.xml").getroot()
    ]
    assert counts == [("3", "1", "0"), ("6", "2", "1")]
    assert "| walker, does not react | 10 | 10 | 2 | 2 | 1 |" in (tmp_path / "summary.md").read_text()
    assert "Newly broken: walker 1:4, walker 1:9\n" in (tmp_path / "summary.md").read_text()
    # 10 d = (1.959964 + 0.841621 sqrt(1 - d))^2 for d = 0.616, more than the share of 5 / 12 that differs
    seen = "with 10 episodes a change of 62 points or more would show in collisions, vehicle moving"
    assert seen in (tmp_path / "summary.md").read_text()


def write_verdict(folder: Path, report: dict[str, Any], table: pl.DataFrame, view: str) -> None:
    listed = failing(report, table)
    write_summary(folder, report, listed, view)
    write_junit(folder, report, listed)


def cases(junit: Path) -> dict[tuple[str | None, str | None], list[str]]:
    """Return class and name of each case -> what is said of it: nothing, or a failure."""
    suites = ET.parse(junit).getroot()
    says = ("failure", "skipped")
    return {
        (case.get("classname"), case.get("name")): [each.tag for each in case if each.tag in says]
        for case in suites.iter("testcase")
    }


def properties(junit: Path) -> dict[str | None, dict[str | None, str | None]]:
    """Return name of each case -> name and value of each of its properties."""
    tests = ET.parse(junit).getroot().iter("testcase")
    return {test.get("name"): {each.get("name"): each.get("value") for each in test.iter("property")} for test in tests}


def test_how_many_episodes_a_change_needs_is_said_before_anything_is_driven(home: Path, tmp_path: Path) -> None:
    few = [word for name, value in EXAM.items() for word in ("--set", f"ads_test.{name}={value}")]
    few += [word for name, value in SHORT.items() for word in ("--set", f"world_simulator.{name}={value}")]
    words = ["ads-test", "-o", str(tmp_path / "new"), "--ads-class", "my_driver:MyDriver", "--detect", "5", *few]
    with class_in_process():
        done = CliRunner().invoke(app, [*words, "--baseline", str(home / "yesterday")])
    assert done.exit_code == 0, done.output
    assert not list((tmp_path / "new").glob("*.json"))
    said = [" ".join(line.split()) for line in done.output.splitlines()]
    assert said[0].startswith("A change of 5 points or more in collisions, vehicle moving shows")
    assert [line.split()[0] for line in said[1:5]] == ["155", "626", "1,568", "155"], "nothing failed yesterday"
    assert said[5].startswith("This exam has 4, which show a change of 100 points")
    assert said[5].endswith("5 points: --episodes 626 in each of 1 scenarios.")


def test_an_exam_without_an_earlier_one_leaves_its_verdict_for_ci_too(home: Path, tmp_path: Path) -> None:
    shutil.copytree(home / "yesterday", tmp_path / "today")
    reasons = run_exam(exam(), tmp_path / "today", ["moving_collision_rate >= 0", "collision_rate > 1"], quiet=True)
    assert cases(tmp_path / "today" / "junit.xml") == {
        ("vpsci ads-test.exam", "every episode was driven"): [],
        ("vpsci ads-test.exam", "arrived in 0 of 4 episodes on the empty road"): [],
        ("vpsci ads-test.walker", "arrived in 0 of 4 episodes"): [],
        ("vpsci ads-test.exam", "moving_collision_rate >= 0 @walker"): ["failure"],
        ("vpsci ads-test.exam", "collision_rate > 1 @walker"): [],
        ("vpsci ads-test.walker", "4 episodes, none of which fails"): [],
    }
    summary = (tmp_path / "today" / "summary.md").read_text()
    assert summary.startswith(f"## my_driver:MyDriver: failed\n\n- {reasons[0]}\n")
    assert "| walker, does not react | 4 | 0 | 0.00 [0.00, 48.99] % | " in summary, "Wilson's interval: z^2 / (4 + z^2)"


def test_what_a_system_says_is_no_markup_in_the_summary() -> None:
    said = "at 0.00 s ValueError: <img src=x> ![a](b) `c` *d* | _e_ f_g\n# h &lt; \\"
    assert _plain(said) == (r"at 0.00 s ValueError: \<img src=x> !\[a\](b) \`c\` \*d\* \| \_e\_ f_g # h \&lt; \\")


def test_a_verdict_without_an_earlier_exam_lists_what_fails_and_fails_by_its_criteria_alone(tmp_path: Path) -> None:
    half = {"value": 0.3, "low": 0.1, "high": 0.6, "n": 10}
    row = {"collision_rate": half, "moving_collision_rate": half, "conflict_rate": half, "arrived_rate": half,
           "time_lost": {"value": None, "low": None, "high": None, "n": 0}}  # fmt: skip
    report = {"exam": {"ads": "new.py"}, "failures": [], "criteria": [], "conduct": {"walker": {"failure": ""}},
              "failure": "moving_collision", "alone": None, "timing": None,
              "drivers": {"ads": {"walker": {"episodes": 10} | row}, "autopilot": {"walker": {}}}}  # fmt: skip
    write_verdict(tmp_path, report, rows(1, 4, 9), "view.html")
    assert cases(tmp_path / "junit.xml") == {
        ("vpsci ads-test.exam", "every episode was driven"): [],
        ("vpsci ads-test.walker", "arrived in 3 of 10 episodes"): [],
        ("vpsci ads-test.walker", "10 episodes, 3 of which fail"): [],
    }
    (out,) = ET.parse(tmp_path / "junit.xml").getroot().iter("system-out")
    assert out.text == "failing (scenario:episode): 1:1 1:4 1:9"
    summary = (tmp_path / "summary.md").read_text()
    share = "30.00 [10.00, 60.00] %"
    assert f"| walker, does not react | 10 | 3 | {share} | {share} | {share} | {share} | - |\n" in summary
    assert "Failing: [walker 1:1](view.html#a=ads-walker&b=autopilot-walker&episode=1:1), [walker 1:4](" in summary


def test_encounters_that_were_not_met_as_timed_fail_in_junit_as_in_the_verdict(tmp_path: Path) -> None:
    def exam_cases(*untimed: str) -> list[str]:
        timing = {"episodes": 10, "own": 10 - len(untimed), "baseline": 0, "untimed": untimed, "hurried": {}}
        report = {"exam": {"ads": "new.py"}, "criteria": [], "conduct": {}, "failure": "moving_collision",
                  "alone": None, "timing": timing, "drivers": {}}  # fmt: skip
        write_verdict(tmp_path, report | {"failures": not_met(report)}, rows(), "")
        return cases(tmp_path / "junit.xml")["vpsci ads-test.exam", "met the pedestrians as timed"]

    assert (exam_cases(), exam_cases("1:3")) == ([], ["failure"])


STANDS = """
class MyDriver:
    def reset(self, begin):
        pass

    def act(self, observation):
        return -8.0
"""


def test_a_system_that_does_not_arrive_on_the_empty_road_fails_with_these_words_unless_it_may_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "stands.py").write_text(STANDS)
    monkeypatch.syspath_prepend(tmp_path)
    with class_in_process():
        stands = prepare(
            exam(episodes=2).sections.changed("ads_test", {"allow_standing": False}), None, "stands:MyDriver"
        )
        (reason,) = run_exam(stands, tmp_path / "out", ["moving_collision_rate > 0"], quiet=True)
        assert reason.startswith("the system does not arrive on the empty road in 2 of 2 episodes")
        allowed = prepare(stands.sections.changed("ads_test", {"allow_standing": True}))
        assert run_exam(allowed, tmp_path / "out", quiet=True) == [], "of the same exam, which is not driven again"
    name = "arrived in 0 of 2 episodes on the empty road"
    assert cases(tmp_path / "out" / "junit.xml")["vpsci ads-test.exam", name] == []
    assert (
        f"On the empty road the system {name.removesuffix(' on the empty road').replace('arrived', 'arrives')}."
        in (tmp_path / "out" / "summary.md").read_text()
    )
    assert "on the empty road in 0 of 2 episodes" in (tmp_path / "out" / "report.html").read_text()


def test_what_cannot_be_compared_is_refused_and_says_why(home: Path, tmp_path: Path) -> None:
    for chosen, against, said in (
        (exam(seed=2), home / "yesterday", r"seed = 1, and this one has 2; give this exam the same --params"),
        (exam(), home, "no exam that is over; expected episodes.parquet in it"),
    ):
        with pytest.raises(InvalidInput, match=said):
            run_exam(chosen, tmp_path / "out", against=against, quiet=True)
    with pytest.raises(InvalidInput, match="newly_failed compares with an earlier exam; name its folder by --baseline"):
        run_exam(exam(), tmp_path / "out", ["newly_failed > 0"], quiet=True)
    assert not (tmp_path / "out").exists()


def test_a_baseline_without_an_episode_in_common_is_refused_and_a_pedestrian_without_one_is_named(
    home: Path, tmp_path: Path
) -> None:
    said = r"no episode in common: that exam drove 1:0, 1:1, 1:2, 1:3, and this one has 1:7; give this exam the same"
    with pytest.raises(InvalidInput, match=said):
        run_exam(exam(only=[1, 7]), tmp_path / "out", against=home / "yesterday", quiet=True)
    assert not (tmp_path / "out").exists()
    none = compare(rows(1), Earlier(Path("out/old"), "old.py", rows(1).filter(pl.col("episode") > 10)), exam())
    assert (none["pedestrians"], none["not_compared"]) == ({}, ["walker"])
    report = {
        "exam": {"ads": "new.py"},
        "failures": [],
        "criteria": [],
        "conduct": {},
        "alone": None,
        "timing": None,
        "drivers": {},
        "against": none,
    }
    write_summary(tmp_path, report, failing(report, rows(1)), "")
    said = "Not compared, for want of an episode in common: walker, does not react\n"
    assert said in (tmp_path / "summary.md").read_text()


def test_what_a_single_episode_in_common_cannot_show_is_said(tmp_path: Path) -> None:
    one = rows(1).filter(pl.col("episode") == 1)
    report = {"exam": {"ads": "new.py"}, "failures": [], "alone": None, "timing": None,
              "drivers": {"ads": {"walker": {}}},
              "against": compare(one, Earlier(Path("out/old"), "old.py", one), exam())}  # fmt: skip
    write_summary(tmp_path, report, failing(report, one), "")
    assert "walker, does not react: nothing is known, for they are too few\n" in (tmp_path / "summary.md").read_text()
    criterion = parse("time_lost_change_low > 0", ["walker"], compared=True)
    (verdict,) = check([criterion], report, ["walker"])
    assert (verdict["failed"], verdict["why"]) == (True, "too few episodes that count in both exams")


def test_the_workflow_of_the_page_examines_and_then_compares(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its steps by a shell, but for the command itself, which is called in this process."""
    page = (Path(__file__).parents[2] / "docs" / "nightly.md").read_text(encoding="utf-8")
    (workflow,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    steps = {step.get("name"): step.get("run") for step in yaml.safe_load(workflow)["jobs"]["exam"]["steps"]}
    shutil.copytree(home / "yesterday", tmp_path / "out" / "main")

    def shell(script: str) -> str:
        environment = os.environ | {"GITHUB_STEP_SUMMARY": str(tmp_path / "summary.md")}
        done = subprocess.run(["bash", "-ec", script], cwd=tmp_path, env=environment, check=True, capture_output=True)
        return done.stdout.decode()

    words = shell(f"vpsci() {{ printf '%s\\n' \"$@\"; }}\n{steps['exam']}").splitlines()
    for node, values in {"world_simulator": SHORT, "ads_test": EXAM}.items():
        words += [word for name, value in values.items() for word in ("--set", f"{node}.{name}={value}")]
    monkeypatch.chdir(tmp_path)
    with class_in_process():
        done = CliRunner().invoke(app, [*words, "--workers", "1"])
    assert done.exit_code == 0, done.output
    assert "newly_failed > 0" in words, "it compares, since there was an earlier exam"
    shell(steps["summary"])
    assert (tmp_path / "summary.md").read_text().startswith("## my_driver:MyDriver: passed\n")
    assert (tmp_path / "out" / "exam" / "junit.xml").is_file()
