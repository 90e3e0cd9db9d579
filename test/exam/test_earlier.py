"""Against an earlier exam: what is driven again, what is fixed, newly broken or unchanged, and how that is said."""

import dataclasses
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.earlier import Earlier, compare, write_junit, write_summary
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.prepare import exam_of, identity_of, prepare
from vpsci_ros.exam.report import ADS
from vpsci_ros.exam.run import run_exam
from vpsci_ros.resources import params_dir

DRIVERS = """
class Careless:
    def reset(self, begin):
        pass

    def act(self, observation):
        return 2.0 * (5.0 - observation.vehicle.speed)

class Lazy(Careless):
    def act(self, observation):
        return -8.0
"""


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the drivers, and with an exam of the careless one in `yesterday`."""
    folder = tmp_path_factory.mktemp("earlier")
    (folder / "drivers_of_earlier.py").write_text(DRIVERS)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        assert run_exam(exam("Careless"), folder / "yesterday", quiet=True) == []
    return folder


def exam(driver: str, **world: Any) -> Exam:
    short = {"scenarios": [1], "episodes": 12, "episode_time": 6.0} | world
    sections = load(params_dir() / "ads_test.yaml").changed("world_simulator", short)
    sections = sections.changed("ads_test", {"pedestrians": ["walker"], "baseline": False})
    return prepare(sections, ads_class=f"drivers_of_earlier:{driver}")


def test_the_same_system_again_changes_nothing_and_another_one_mends_what_it_mends(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(home)
    before = pl.read_parquet(home / "yesterday" / "episodes.parquet").filter(pl.col("pedestrian") == "walker")
    failed = [f"1:{number}" for number in before.filter(pl.col("moving_collision"))["episode"]]
    assert failed

    criteria = ["newly_failed > 0", "moving_collision_rate_change_low > 0"]
    assert run_exam(exam("Careless"), tmp_path / "same", criteria, against=home / "yesterday", quiet=True) == []
    row = json.loads((tmp_path / "same" / "report.json").read_text())["against"]["pedestrians"]["walker"]
    assert (row["fixed"], row["newly_failed"], row["still_failing"]) == ([], [], failed)
    assert row["same"] == row["episodes"] == 12
    assert row["differences"]["time_lost"]["value"] == 0.0

    reasons = run_exam(exam("Lazy"), tmp_path / "lazy", ["fixed > 0", "newly_failed > 0"],
                       against=home / "yesterday", guard=2, quiet=True)  # fmt: skip
    assert reasons == [f"fixed > 0: {len(failed)} with walker, failed"]
    found = json.loads((tmp_path / "lazy" / "report.json").read_text())["against"]
    assert found["guard"] == 2
    assert found["pedestrians"]["walker"]["fixed"] == failed
    assert found["pedestrians"]["walker"]["fixed_rate"]["n"] == len(failed)
    assert found["pedestrians"]["walker"]["differences"]["moving_collision_rate"]["n"] == 2
    driven = pl.read_parquet(tmp_path / "lazy" / "episodes.parquet").filter(pl.col("pedestrian") == "walker")
    guarded = before.sort("episode")["episode"].to_numpy()[np.random.default_rng(1).permutation(12)[:2]]
    assert {f"1:{number}" for number in driven["episode"]} == {*failed, *(f"1:{number}" for number in guarded)}
    summary = (tmp_path / "lazy" / "summary.md").read_text()
    assert summary.startswith("## drivers_of_earlier:Lazy: failed\n")
    assert f"Fixed: [walker {failed[0]}](view.html#a=ads-walker&b=autopilot-walker&episode={failed[0]})" in summary
    assert "Against yesterday" in (tmp_path / "lazy" / "report.html").read_text()


def rows(*failing: int) -> pl.DataFrame:
    columns = {"outcome": "goal", "driven": 5.0, "duration": 6.0, "impact_speed": 1.0, "hardest_braking": 1.0,
               "driver": ADS, "pedestrian": "walker", "scenario": 1, "collision": False, "conflict": False,
               "severe_conflict": False, "hard_braking": False, "time_lost": 1.0, "critical": True}  # fmt: skip
    failed = [number in failing for number in range(10)]
    return pl.DataFrame({"episode": range(10), "moving_collision": failed, "least_curvttc": 1.0}).with_columns(
        pl.lit(value).cast(pl.Int64 if name == "scenario" else None or type(value)).alias(name)
        for name, value in columns.items()
    )


def verdict(guard: int, monkeypatch: pytest.MonkeyPatch, home: Path) -> dict[str, Any]:
    monkeypatch.syspath_prepend(home)
    chosen = rows().select("scenario", "episode").head(guard)
    return compare(rows(1, 4, 9), Earlier(Path("out/old"), "old.py", rows(1, 2, 3), chosen), exam("Careless"))


def test_what_is_newly_broken_is_a_share_of_the_guard_set_and_what_is_fixed_of_all_that_failed(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = verdict(6, monkeypatch, home)["pedestrians"]["walker"]
    assert (row["fixed"], row["newly_failed"], row["still_failing"]) == (["1:2", "1:3"], ["1:4", "1:9"], ["1:1"])
    assert (row["fixed_rate"]["value"], row["fixed_rate"]["n"]) == (pytest.approx(2 / 3), 3)
    assert (row["newly_failed_rate"]["value"], row["newly_failed_rate"]["n"]) == (pytest.approx(1 / 3), 3), "of 0, 4, 5"
    assert row["differences"]["moving_collision_rate"]["value"] == pytest.approx((1 - 2) / 6)
    assert row["same"] == 10, "as far as these columns tell"


def test_junit_fails_what_is_newly_broken_skips_what_failed_before_and_passes_what_is_fixed(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    criterion = {"criterion": "newly_failed > 0", "pedestrian": "walker", "value": 2.0, "failed": True}
    report = {"exam": {"ads": "new.py"}, "failures": ["newly_failed > 0: 2"], "criteria": [criterion],
              "conduct": {"walker": {"failure": ""}}, "against": verdict(10, monkeypatch, home)}  # fmt: skip
    write_junit(tmp_path / "junit.xml", report)
    suites = ET.parse(tmp_path / "junit.xml").getroot()
    said = {
        (case.get("classname"), case.get("name")): [child.tag for child in case] for case in suites.iter("testcase")
    }
    of = "vpsci ads-test.walker"
    assert said == {
        ("vpsci ads-test.exam", "every episode was driven"): [],
        ("vpsci ads-test.exam", "newly_failed > 0 @walker"): ["failure"],
        (of, "1:2"): [], (of, "1:3"): [], (of, "1:4"): ["failure"], (of, "1:9"): ["failure"], (of, "1:1"): ["skipped"],
    }  # fmt: skip
    counts = [(suite.get("tests"), suite.get("failures"), suite.get("skipped")) for suite in suites]
    assert counts == [("2", "1", "0"), ("5", "2", "1")]
    write_summary(tmp_path / "summary.md", report, "")
    assert "| walker, does not react | 10 | 10 | 2 | 2 | 1 |" in (tmp_path / "summary.md").read_text()
    assert "Newly broken: walker 1:4, walker 1:9\n" in (tmp_path / "summary.md").read_text()


def test_what_cannot_be_compared_is_refused_and_says_why(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(home)
    for chosen, against, said in (
        (
            exam("Lazy", seed=2),
            home / "yesterday",
            r"seed = 1, and this one has 2; give this exam the same --params",
        ),
        (exam("Lazy"), home, "no exam that is over; expected episodes.parquet in it"),
    ):
        with pytest.raises(InvalidInput, match=said):
            run_exam(chosen, tmp_path / "out", against=against, quiet=True)
    with pytest.raises(InvalidInput, match="newly_failed compares with an earlier exam; name its folder by --baseline"):
        run_exam(exam("Lazy"), tmp_path / "out", ["newly_failed > 0"], quiet=True)
    assert not (tmp_path / "out").exists()


def test_the_workflow_of_the_page_examines_and_then_compares(home: Path, tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "nightly.md").read_text(encoding="utf-8")
    (workflow,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    steps = {step.get("name"): step.get("run") for step in yaml.safe_load(workflow)["jobs"]["exam"]["steps"]}
    (tmp_path / "my_driver.py").write_text(DRIVERS + "\n\nclass MyDriver(Lazy):\n    pass\n")
    short = (
        "--set world_simulator.scenarios=[1] --set world_simulator.episodes=12 --set world_simulator.episode_time=6.0 "
    )
    short += "--set ads_test.pedestrians=[walker] --set ads_test.baseline=false --workers 1"
    script = "\n".join(
        [
            f'set -e\nvpsci() {{ "{sys.executable}" -m vpsci_ros.cli "$@" {short}; }}',
            f"mkdir out\ncp -r {home / 'yesterday'} out/main",
            str(steps["exam"]),
            str(steps["summary"]),
        ]
    )
    written = tmp_path / "summary.md"
    environment = os.environ | {"GITHUB_STEP_SUMMARY": str(written)}
    subprocess.run(["bash", "-c", script], cwd=tmp_path, env=environment, check=True, capture_output=True)
    assert written.read_text().startswith("## my_driver:MyDriver: passed\n")
    assert (tmp_path / "out" / "exam" / "junit.xml").is_file()


def test_recorded_people_of_a_guard_set_are_the_same_ones_when_the_exam_is_read_again(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(home)
    whole = exam("Careless")
    whole = dataclasses.replace(whole, config=dataclasses.replace(whole.config, recorded="right_turns"))
    part = dataclasses.replace(whole.only([(1, 5), (1, 9)]), whole=whole)
    again = exam_of(json.loads(json.dumps(identity_of(part))))
    first, second = part.motion("recorded"), again.motion("recorded")
    assert first.keys() == second.keys() == {(1, 5), (1, 9)}
    assert all(np.array_equal(first[key], second[key]) for key in first)
