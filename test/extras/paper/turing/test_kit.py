"""The kit: clips balanced, blinded and equal in all but behaviour; answers checked before they count."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import synthetic_near_misses
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.turing.answers import read_answers
from vpsci_ros.extras.paper.turing.clips import FRAMES, SOURCES
from vpsci_ros.extras.paper.turing.kit import KEY, PAGE, make_kit


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "people.parquet"
    write_near_misses(synthetic_near_misses(interactions=60, seed=4).table, path)
    return path


@pytest.fixture(scope="module")
def kit(table: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kit") / "kit"
    make_kit(table, "people", folder, scenes=4, seed=2)
    return folder


def shown(kit: Path) -> dict[str, Any]:
    """Return what the questionnaire holds: clip -> float[T, 5]."""
    page = (kit / PAGE).read_text(encoding="utf-8")
    text = page.split("id=kit>")[1].split("</script>")[0]
    return {clip["name"]: np.array(clip["values"]) for clip in json.loads(text)["clips"]}


def key(kit: Path) -> dict[str, Any]:
    return json.loads((kit / KEY).read_text())


def answers(kit: Path, rater: str, **changes: Any) -> dict[str, Any]:
    rows = [{"clip": name, "judgement": "real", "realism": 3} | changes
            for name in key(kit)["clips"]]  # fmt: skip
    return {"kit": key(kit)["kit"], "rater": rater, "answers": rows}


def test_the_same_kit_again_is_made_whole_and_another_one_refused(kit: Path, table: Path) -> None:
    page = (kit / PAGE).read_bytes()
    (kit / PAGE).write_bytes(b"")
    make_kit(table, "people", kit, scenes=4, seed=2)
    assert (kit / PAGE).read_bytes() == page
    with pytest.raises(InvalidInput, match="choose another output folder"):
        make_kit(table, "people", kit, scenes=4, seed=3)


def test_the_page_says_nothing_of_sources(kit: Path) -> None:
    page = (kit / PAGE).read_text(encoding="utf-8")
    assert not [
        word
        for word in (*SOURCES, "people", "synthetic", "control")
        if word in page.split("id=kit>")[1].split("</script>")[0]
    ]
    order = [key(kit)["clips"][name]["source"] for name in shown(kit)]
    assert order != sorted(order)


def test_clips_have_one_length_and_those_of_a_scene_one_beginning(kit: Path) -> None:
    clips, of = shown(kit), key(kit)["clips"]
    assert {values.shape for values in clips.values()} == {(FRAMES, 5)}
    for scene in range(4):
        same = [clips[name] for name in clips if of[name]["scene"] == scene]
        for values in same[1:]:
            np.testing.assert_allclose(values[:7], same[0][:7], atol=0.01)
            assert np.abs(values - same[0]).max() > 0.05


def test_scores_are_written_beside_the_papers(kit: Path, tmp_path: Path) -> None:
    paths = []
    for row in range(3):
        document = answers(kit, f"rater <{row}>")
        for answer in document["answers"]:
            made = key(kit)["clips"][answer["clip"]]["source"] == "rule_based"
            answer |= {"judgement": "made" if made else "real", "realism": 1 + row if made else 4}
        paths.append(tmp_path / f"{row}.json")
        paths[-1].write_text(json.dumps(document))
    result = CliRunner().invoke(app, ["turing", "score", str(kit / KEY), *map(str, paths), "-o", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    page = (tmp_path / "out/turing.html").read_text(encoding="utf-8")
    assert "-13.5" in page
    numbers = json.loads((tmp_path / "out/turing.json").read_text())
    assert numbers["rated_real"] == {"recorded": 1.0, "generated": 1.0, "rule_based": 0.0}
    assert numbers["realism"]["recorded"] == 4.0


def test_answers_of_another_kit_incomplete_ones_and_one_rater_twice_are_refused(kit: Path, tmp_path: Path) -> None:
    good, other, short, broken, six = (tmp_path / f"{name}.json" for name in ("good", "other", "short", "broken", "6"))
    six.write_text(json.dumps(answers(kit, "d", realism=6)))
    good.write_text(json.dumps(answers(kit, "a")))
    other.write_text(json.dumps(answers(kit, "b") | {"kit": "0"}))
    short.write_text(json.dumps(answers(kit, "c") | {"answers": answers(kit, "c")["answers"][1:]}))
    broken.write_text("{")
    refused = {
        "answers to the kit 0": [other],
        "realism = 6, expected a whole number 1 to 5": [six],
        "1 of 12 clips are not answered": [short],
        "rater a is there twice": [good, good],
        "as JSON": [broken],
        "at least one rater": [],
    }
    for message, paths in refused.items():
        with pytest.raises(InvalidInput, match=message):
            read_answers(kit / KEY, paths)
