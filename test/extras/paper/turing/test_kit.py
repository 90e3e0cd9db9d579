"""The kit: clips balanced, blinded and equal in all but behaviour; answers checked before they count."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import synthetic_near_misses
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.data.near_misses import read_near_misses, write_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.realism.simulators import rule_based
from vpsci_ros.extras.paper.turing.answers import read_answers
from vpsci_ros.extras.paper.turing.clips import FRAMES, SOURCES, draw_scenes, equalised
from vpsci_ros.extras.paper.turing.kit import KEY, PAGE, make_kit
from vpsci_ros.world.kinematics import MAX_DECELERATION


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
    rows = [{"clip": name, "judgement": "real", "confidence": 2, "realism": 3, "seconds": 1.5, "shown": 1} | changes
            for name in key(kit)["clips"]]  # fmt: skip
    return {"kit": key(kit)["kit"], "rater": rater, "answers": rows}


def test_every_scene_is_shown_once_by_every_source(kit: Path) -> None:
    found = sorted((clip["scene"], clip["source"]) for clip in key(kit)["clips"].values())
    assert found == sorted((scene, source) for scene in range(4) for source in SOURCES)


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


def test_the_same_seed_draws_the_same_kit_and_another_one_another(table: Path, kit: Path, tmp_path: Path) -> None:
    again = make_kit(table, "people", tmp_path / "again", scenes=4, seed=2)
    other = make_kit(table, "people", tmp_path / "other", scenes=4, seed=3)
    assert again["kit"] == key(kit)["kit"] != other["kit"]


def test_the_control_walks_on_goes_on_turning_and_brakes_fully_for_who_is_near_and_ahead(table: Path) -> None:
    onsets = draw_scenes(read_near_misses(table), 2, 2)
    motion = onsets.interactions.motion.copy()
    angle = 0.1 * 0.5 * (np.arange(motion.shape[1]) - onsets.interactions.first[:, None])  # a circle of 10 m at 5 m/s
    motion[..., 0], motion[..., 1], motion[..., 2] = 10.0 * np.sin(angle), 10.0 - 10.0 * np.cos(angle), angle
    motion[..., 3], motion[..., 4] = 5.0 * np.cos(angle), 5.0 * np.sin(angle)
    motion[..., 5:9] = 60.0, 0.0, -1.0, 0.5
    motion[1, :, 5:9] = 5.0, 0.4, 0.0, 0.0  # in the way
    free, blocked = rule_based(
        dataclasses.replace(onsets, interactions=onsets.interactions.moving(motion)), reacting=False, turning=True
    )[:, 0]
    later = 0.05 * np.arange(1, 31)
    assert free[0] == pytest.approx(np.column_stack([10.0 * np.sin(later), 10.0 - 10.0 * np.cos(later)]), abs=0.06)
    assert free[1] == pytest.approx([60.0, 0.0] + 0.1 * np.arange(1, 31)[:, None] * [-1.0, 0.5])
    way = np.hypot(*np.diff(blocked[0], axis=0).T).sum() + np.hypot(*blocked[0][0])
    assert way == pytest.approx(5.0**2 / 2.0 / MAX_DECELERATION, abs=0.1)


def test_smoothing_takes_jitter_away_and_leaves_turns_and_standing_vehicles_alone() -> None:
    t = np.arange(FRAMES) * 0.1
    turning = np.column_stack([8.0 * np.sin(0.4 * t), 8.0 - 8.0 * np.cos(0.4 * t)])
    standing = np.zeros((FRAMES, 2)) + np.random.default_rng(1).normal(0.0, 0.004, (FRAMES, 2))
    noise = np.random.default_rng(2).normal(0.0, 0.03, turning.shape)
    clean, jittered = (equalised(np.stack([track, track]), 0.0) for track in (turning, turning + noise))
    np.testing.assert_allclose(clean[:, :2], turning, atol=0.01)
    np.testing.assert_allclose(clean[2:-2, 2], 0.4 * t[2:-2], atol=0.01)
    second = lambda track: np.abs(np.diff(track, 2, axis=0)).mean()  # noqa: E731
    assert second(jittered[:, :2] - clean[:, :2]) < 0.5 * second(noise)
    assert (equalised(np.stack([standing, standing]), 1.2)[:, 2] == 1.2).all()


def test_more_scenes_than_there_are_is_refused(table: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"expected 200 scenes .* found \d+; ask for fewer"):
        make_kit(table, "people", tmp_path / "kit", scenes=200, seed=1)
    assert not (tmp_path / "kit").exists()


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
    assert "rater &lt;0&gt;" in page
    assert "-13.5" in page
    numbers = json.loads((tmp_path / "out/turing.json").read_text())
    assert numbers["rated_real"]["rule_based"]["value"] == 0.0
    assert numbers["recognised"]["rule_based"]["accuracy"]["value"] == 1.0
    assert numbers["realism"]["recorded"]["value"] == 4.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"realism": 6}, "realism = 6, expected a whole number 1 to 5"),
        ({"confidence": True}, "confidence = True, expected a whole number"),
        ({"judgement": "both"}, "judgement = 'both', expected real or made"),
        ({"seconds": -1.0}, r"seconds = -1\.0, expected a time"),
        ({"clip": "c?"}, "clip 'c\\?', which the key does not have"),
    ],
)
def test_bad_answers_are_refused_with_the_clip_and_what_was_expected(kit, tmp_path, change, message) -> None:
    (tmp_path / "a.json").write_text(json.dumps(answers(kit, "a", **change)))
    with pytest.raises(InvalidInput, match=message):
        read_answers(kit / KEY, [tmp_path / "a.json"])


def test_answers_of_another_kit_incomplete_ones_and_one_rater_twice_are_refused(kit: Path, tmp_path: Path) -> None:
    good, other, short, broken = (tmp_path / name for name in ("good.json", "other.json", "short.json", "broken.json"))
    good.write_text(json.dumps(answers(kit, "a")))
    other.write_text(json.dumps(answers(kit, "b") | {"kit": "0"}))
    short.write_text(json.dumps(answers(kit, "c") | {"answers": answers(kit, "c")["answers"][1:]}))
    broken.write_text("{")
    refused = {
        "answers to the kit 0": [other],
        "1 of 12 clips are not answered": [short],
        "rater a is there twice": [good, good],
        "as JSON": [broken],
        "at least one rater": [],
    }
    for message, paths in refused.items():
        with pytest.raises(InvalidInput, match=message):
            read_answers(kit / KEY, paths)
