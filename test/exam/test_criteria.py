"""Criteria for failing: parsed without evaluating anything, refused with a hint, compared with a report."""

from pathlib import Path

import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.criteria import NAMES, check, parse, sentence
from vpsci_ros.exam.report import CHANGES, COUNTS, FAILED_BEFORE, INCREASES
from vpsci_ros.exam.scores import DIFFERENCES, MEASURES

PEDESTRIANS = ["learned", "walker"]


def report(**rates: float | None) -> dict:
    rows = {name: {"collision_rate": {"value": value}, "time_lost": {"value": 2.0}} for name, value in rates.items()}
    return {
        "drivers": {"ads": rows},
        "differences": {"walker": {"collision_rate": {"value": 0.3}}},
        "conduct": {"learned": {"commands_refused": 4}, "walker": {"commands_refused": 0}},
    }


def failed(text: str, **rates: float | None) -> list[str]:
    return [v["pedestrian"] for v in check([parse(text, PEDESTRIANS)], report(**rates), PEDESTRIANS) if v["failed"]]


def test_a_criterion_holds_for_any_pedestrian_unless_it_names_one():
    assert failed("collision_rate > 0.05", learned=0.02, walker=0.2) == ["walker"]
    assert failed("collision_rate>5e-2@learned", learned=0.02, walker=0.2) == []
    assert failed("  collision_rate  >  .01  @ learned ", learned=0.02, walker=0.2) == ["learned"]


@pytest.mark.parametrize(("sign", "expected"), [(">", False), (">=", True), ("<", False), ("<=", True)])
def test_each_operator_means_what_it_says_at_the_limit(sign, expected):
    assert bool(failed(f"collision_rate {sign} 0.02 @learned", learned=0.02, walker=0.0)) is expected


def test_what_could_not_be_measured_fails():
    assert failed("collision_rate > 0.05 @learned", learned=None, walker=0.0) == ["learned"]
    assert failed("evasion_success_rate < 0.9 @walker", learned=0.0, walker=0.0) == ["walker"]
    verdict = check([parse("collision_rate > 1 @learned", PEDESTRIANS)], report(learned=None), PEDESTRIANS)[0]
    assert verdict["value"] is None
    assert sentence(verdict) == "collision_rate > 1 @learned: not measured (default pedestrian), failed"


def test_no_contact_satisfies_a_bound_on_impact_speed_and_no_episode_satisfies_none() -> None:
    rows = {"impact_speed": {"value": None}, "evasion_success_rate": {"value": None}, "collision_rate": {"value": 0.0}}
    drove = {"drivers": {"ads": {"learned": rows}}}

    def said(text: str) -> str:
        (verdict,) = check([parse(text, PEDESTRIANS)], drove, PEDESTRIANS)
        return sentence(verdict).partition(": ")[2]

    assert said("impact_speed > 3 @learned") == "no contact (default pedestrian), passed"
    assert said("impact_speed > 3 @walker") == "no episode was driven (walker, does not react), failed"
    assert said("evasion_success_rate < 0.9 @learned") == "no critical episode (default pedestrian), failed"
    assert said("collision_rate > 0 @walker") == "no episode was driven (walker, does not react), failed"


@pytest.mark.parametrize("label", ["SR-12", "SG 3/FSR.4 (draft)", "req: 7"])
def test_a_criterion_carries_the_label_of_its_requirement(label: str) -> None:
    criterion = parse(f" {label} : collision_rate > 0.05 @learned", PEDESTRIANS)
    assert (criterion.requirement, criterion.measure, criterion.limit) == (label, "collision_rate", 0.05)
    (verdict,) = check([criterion], report(learned=0.2), PEDESTRIANS)
    assert (verdict["requirement"], verdict["failed"]) == (label, True)
    assert parse("collision_rate > 0.05", PEDESTRIANS).requirement == ""


def test_increases_compare_with_the_learned_pedestrian_and_counts_are_those_of_the_run():
    assert failed("collision_increase > 0.1", learned=0.0, walker=0.3) == ["walker"]
    assert failed("commands_refused > 0", learned=0.0, walker=0.3) == ["learned"]


@pytest.mark.parametrize(
    "text",
    [
        "", "collision_rate", "collision_rate > ", "> 0.05", "collision_rate > a", "collision_rate > 0.05 @",
        "collision_rate == 0.05", "collision_rate > nan", "collision_rate > inf", "collision_rate > 0.05; x > 1",
        "__import__('os').system('true') > 0", "collision_rate > (1)", "collision_rate > 0.05 @learned @walker",
        ": collision_rate > 0.05", "SR-12:collision_rate > 0.05", "SR-12 collision_rate > 0.05",
    ],
)  # fmt: skip
def test_anything_of_another_form_is_refused_with_the_form_and_the_measures(text):
    with pytest.raises(
        InvalidInput, match=r"expected \[REQUIREMENT: \]MEASURE \{>,>=,<,<=\} NUMBER \[@PEDESTRIAN\]"
    ) as error:
        parse(text, PEDESTRIANS)
    assert all(name in str(error.value) for name in NAMES)


def test_an_unknown_measure_is_refused_with_the_nearest_and_all_there_are():
    with pytest.raises(InvalidInput, match="unknown measure 'colision_rate'; did you mean collision_rate") as error:
        parse("colision_rate > 0.05", PEDESTRIANS)
    assert all(name in str(error.value) for name in NAMES)


@pytest.mark.parametrize("measure", ["collision_rate", "collision_increase", "arrived_rate_change_low"])
def test_a_share_beyond_1_as_percent_are_is_refused_for_it_would_never_hold(measure: str) -> None:
    with pytest.raises(InvalidInput, match=rf"{measure} is a share, 0 to 1; expected .* 0.05 for 5%, got 5$"):
        parse(f"{measure} > 5", PEDESTRIANS, compared=True)
    for text in (f"{measure} > 1", "time_lost_change_low > 5", "newly_failed > 5", "commands_refused > 5"):
        parse(text, PEDESTRIANS, compared=True)


def test_the_pages_name_every_measure_that_a_criterion_may_name() -> None:
    ads, nightly = ((Path(__file__).parents[2] / "docs" / name).read_text() for name in ("ads.md", "nightly.md"))
    assert [name for name in (*MEASURES, *INCREASES, *COUNTS) if f"`{name}`" not in ads] == []
    assert [name for name in (*DIFFERENCES, *FAILED_BEFORE) if f"`{name}`" not in nightly] == []
    ends = {name.removeprefix(measure) for measure in DIFFERENCES for name in CHANGES if name.startswith(measure)}
    assert [end for end in ends if f"`MEASURE{end}`" not in nightly] == []


def test_a_pedestrian_that_the_exam_lacks_is_refused():
    with pytest.raises(InvalidInput, match="no pedestrian 'recorded' in this exam; it has learned, walker"):
        parse("collision_rate > 0.05 @recorded", PEDESTRIANS)


def test_an_increase_needs_the_learned_pedestrian_and_another():
    for pedestrians, text in ((["walker"], "collision_increase > 0"), (["learned"], "collision_increase > 0"),
                      (PEDESTRIANS, "collision_increase > 0 @learned")):  # fmt: skip
        with pytest.raises(InvalidInput, match="the exam needs both"):
            parse(text, pedestrians)
